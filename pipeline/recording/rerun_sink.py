"""Writes a run as a rerun recording: the only module that logs to rerun."""

from __future__ import annotations

import dataclasses
import json
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.filter.own_sensor import beam_density
from pipeline.filter.step import Step
from pipeline.filter.substeps import SubStep
from pipeline.geometry import between
from pipeline.logs.messages import Log
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.motion.faults import without_leaps
from pipeline.outputs import told
from pipeline.recording import documents, entities, palette
from pipeline.recording.blueprint import blueprint, known_area
from pipeline.recording.columns import (
    Columns,
    Frame,
    IsHit,
    batch_columns,
    changes,
    segments,
    timelines,
    transforms,
    verdicts,
)
from pipeline.recording.gaps import longest_interval
from pipeline.recording.layout import SentLayout
from pipeline.recording.sampling import draw, weight_bars
from pipeline.recording.scales import Scales
from pipeline.recording.sensor_parts import SensorParts, logged
from pipeline.recording.styles import drawn_map, scale_bars, styles
from pipeline.recording.substeps import substep_columns, substep_styles, substep_tab
from pipeline.recording.told_columns import Teller, Told, are_apart, told_columns, told_styles, worst_beams
from pipeline.recording.truth import JUMP, truth_at_scans
from pipeline.recording.versions import versions
from pipeline.recording.witness_columns import Row, witness_columns, witness_styles
from pipeline.recording.witness_views import ground, motion_tab
from pipeline.recording.witnesses import Hearing

BATCH = 96  # scans per write: fewer cost time and bytes, more lose more when the process is killed
ROOM = 1_000_000
"""Bytes that must be free: rerun waits for ever where not even the layout of its views can be written."""
ABOVE = 0.03  # of the map's size, above the estimate: where its name stands
NEVER = 1e6  # seconds
HEAT_SHOWN = 1.0  # seconds that a search stays on the map


class RerunSink:
    """A recording that grows with the run and is complete once closed.

    ``path``: the .rrd, which must not exist; its folder must. ``log``: what was localised, with its map;
    ``viewer``: the address of one that shows the run while it goes on; if that goes away, the file is still written.
    ``substeps``: sub-steps will be logged as well, and are shown first.
    Whatever was written in whole batches can be read even if the process is killed.
    Raises MclError for a log without a map, or where the file cannot be written.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        log: Log,
        config: Config,
        seed: int,
        viewer: str | None = None,
        substeps: bool = False,
    ) -> None:
        if log.grid is None:
            raise MclError("the log holds no map, and a recording is drawn on one", path=log.path)
        self.path = Path(path)
        if self.path.exists():
            raise MclError("this recording exists already and is never overwritten", path=self.path)
        if not self.path.parent.is_dir():
            raise MclError("the recording's folder does not exist", path=self.path.parent)
        with told(self.path), tempfile.TemporaryFile(dir=self.path.parent) as probe:
            probe.write(bytes(ROOM))
            probe.flush()
        self._log, self._config, self._seed = log, config, seed
        self._odometry = without_leaps(log.times, log.odometry)
        self._frames: list[Frame] = []
        self._outbox: list[Columns] = []
        self._previous: tuple[Step, NDArray[np.float64]] | None = None
        self._heated: float | None = None
        self._verdict = ""
        # Who hears the wheels alone has nothing to compare them with.
        self._wheels = log.wheels and config.odometry != "laser"
        self._laser = config.odometry != "wheels" or not log.wheels
        self._hearing = Hearing(log.laser, wheels=self._wheels)
        self._heard: list[Row] = []
        self._contradicted = False
        self._longest_interval = longest_interval(log.times)
        self._truth = truth_at_scans(log)
        self._teller, self._told, self._apart = Teller(self._truth), list[Told](), False
        self._above = ABOVE * max(known_area(log.grid).size)
        self._curves: dict[str, list[float]] = defaultdict(list)
        longest = log.laser.longest(config.laser_max_range)
        assert log.grid is not None, "a log without a map"
        model = beam_density(config, longest, log.grid, log.laser)
        self._is_hit: IsHit = model.is_hit
        self._sensor = SensorParts(config, model, longest)
        self._closed = False
        self._viewed = viewer is not None
        rr.set_strict_mode(True)  # otherwise rerun warns and drops the data
        # Written when told and never by the clock: what came between two of its ticks would change the order.
        self._stream = rr.RecordingStream(
            entities.APPLICATION_ID,
            recording_id=entities.recording_id(log, config, seed),
            batcher_config=rr.ChunkBatcherConfig(flush_tick=NEVER),
        )
        self._stream.set_log_time_enabled(False)
        self._started = np.datetime64(time.time_ns(), "ns")
        self._substeps = 0 if substeps else None
        try:
            sinks = [rr.FileSink(self.path), *([] if viewer is None else [rr.GrpcSink(viewer)])]
            self._stream.set_sinks(*sinks)
            self._layout = SentLayout(self._views(Scales()), self._stream, entities.APPLICATION_ID)
        except Exception as error:
            raise MclError(f"cannot write the recording: {error}", path=self.path) from error
        self._log_map(log.grid)
        self._log_styles()
        self._log_documents()
        self._log_truth()
        try:
            self._wait()  # what a killed run leaves shall say which run it was
        except MclError:
            self._stream.disconnect()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def log(self, step: Step) -> None:
        """Adds one step; the views it holds may change afterwards."""
        drawn = draw(len(step.particles), self._config.record_particles, self._seed, step.index)
        bars, share = weight_bars(step.log_weights)
        pose = np.array(step.estimate.pose, dtype=np.float64)
        joined = self._joins(step)
        before = None if self._previous is None else self._previous[0].time
        silent = before is not None and step.time - before > self._longest_interval
        frame = Frame(
            step=dataclasses.replace(step, particles=_NO_PARTICLES, log_weights=_NO_WEIGHTS),
            particles=step.particles[drawn],
            levels=palette.weight_levels(step.log_weights, drawn),
            count=len(step.particles),
            bars=bars,
            weight_bars=share,
            previous=pose if self._previous is None else self._previous[1],
            joined=joined,
            silent_since=before if silent else None,
        )
        told = self._teller.tell(frame.step, step.time - before if before is not None and silent else None)
        self._told.append(told)
        for entity, value in (
            (entities.SPREAD, step.spread), (entities.LIKELIHOOD, step.mean_likelihood),
            (entities.PARTICLE_COUNT, frame.count), (entities.TWO_SIGMA, told.two_sigma),
            (entities.ERROR, np.nan if told.missed is None else told.missed.distance),
        ):  # fmt: skip
            self._curves[entity].append(value)
        if (heard := self._hearing.hear(step, joined)) is not None:
            self._heard.append((frame.step, heard))
        self._previous = (step, pose)
        self._frames.append(frame)
        self._log_heat(step)
        if len(self._frames) >= BATCH:
            self._flush()

    def log_substep(self, substep: SubStep) -> None:
        """Adds a part of a turn, which is drawn on a timeline of its own; for who said that there would be some."""
        assert self._substeps is not None
        self._outbox += substep_columns([substep], self._substeps, self._seed, self._truth_at(substep.scan))
        self._substeps += 1

    def finish(self, summary: dict[str, Any], hindsight: NDArray[np.float64] | None = None) -> None:
        """Adds what is known only at the end: JSON-like figures, and under "timings" wall times in seconds by name;
        and the path in hindsight, (n, 3) poses in the map frame, one for each scan.

        Wall times differ between equal runs. They are stored on the wall-clock timeline, which ``rerun rrd
        compare`` leaves out, so that equal runs compare as equal: a first row without a name, then the parts
        laid end to end, each at its end. So the rows, which rerun sorts by time, keep their order.
        """
        self._flush()
        if hindsight is not None:
            self._log_hindsight(hindsight)
        timings = summary.get("timings", {})
        figures = {key: value for key, value in summary.items() if key != "timings"}
        self._property(entities.PROPERTY_RESULT, {"figures": json.dumps(figures, default=_plain, allow_nan=True)})
        self._document(entities.RESULT, documents.result(figures))
        took = np.array([0, *(round(float(seconds) * 1e9) for seconds in timings.values())], "timedelta64[ns]").cumsum()
        columns = rr.DynamicArchetype.columns(entities.TIMING_TYPE, components={"name": ["", *timings]})
        clock = rr.TimeColumn(entities.LOG_TIME, timestamp=self._started + took)
        self._stream.send_columns(entities.TIMINGS, [clock], columns)
        self._log_sensor_model()
        # Only now it is known how high the curves reach.
        scales = Scales.of({entity: np.array(values) for entity, values in self._curves.items()})
        self._layout.rescale(self._views(scales))

    def close(self) -> None:
        """Writes what is left and the file's footer; closing twice does nothing more."""
        if self._closed:
            return
        self._closed = True
        try:
            self._flush()
        finally:
            try:
                self._wait()
            finally:
                self._stream.disconnect()

    def _views(self, scales: Scales) -> rrb.Blueprint:
        log = self._log
        assert log.grid is not None
        return blueprint(
            log.grid,
            scales=scales,
            truth=self._truth is not None,
            motion=motion_tab(ground(log), wheels=self._wheels) if self._laser else None,
            substeps=None if self._substeps is None else substep_tab(known_area(log.grid)),
        )

    def _wait(self) -> None:
        """Until all is written; a viewer that somebody closed meanwhile is no reason to lose the run."""
        try:
            self._stream.flush()
        except RuntimeError as error:
            if not self._viewed:
                said = "no more can be written: the disk is full, or somebody took the folder away"
                raise MclError(said, "the run is not kept", path=self.path) from error

    def _flush(self) -> None:
        # Built first, then sent one by one: an interrupt in between loses nothing, close() sends the rest.
        if self._frames:
            self._outbox += batch_columns(self._frames, self._is_hit)
            steps = [frame.step for frame in self._frames]
            self._outbox += [*verdicts(steps, self._verdict), *changes(steps), worst_beams(steps, self._is_hit)]
            self._outbox += told_columns(self._told, self._apart, self._above)
            self._apart, self._told = are_apart(self._told[-1]), []
            self._sensor.hear(steps)
            self._verdict = steps[-1].verdict.kind
            if self._heard:
                silent = [f.silent_since for f in self._frames if f.silent_since is not None]
                self._outbox += witness_columns(self._heard, shown=self._contradicted, silent=silent)
                self._contradicted = self._heard[-1][1].said is not None
            self._frames, self._heard = [], []
        while self._outbox:
            self._stream.send_columns(*self._outbox[0])
            del self._outbox[0]

    def _truth_at(self, scan: int) -> NDArray[np.float64] | None:
        if self._truth is None or scan not in self._truth[0]:
            return None
        return self._truth[1][self._truth[0] == scan]

    def _joins(self, step: Step) -> bool:
        if self._previous is None:
            return False
        before, pose = self._previous
        odometry = between(self._odometry[before.index], self._odometry[step.index])
        travelled, jumped = np.hypot(*odometry[:2]), np.hypot(*(step.estimate.pose[:2] - pose[:2]))
        return bool(jumped <= travelled + JUMP)

    def _log_heat(self, step: Step) -> None:
        """The cells of a search, for a second; sent at once, since there are few of them and many cells."""
        over = self._heated is not None and step.time > self._heated + HEAT_SHOWN
        if step.heat is None and not over:
            return
        heat = step.heat if step.heat is not None else np.empty((0, 3), np.float32)
        heat = heat[heat[:, 2] > -palette.HEAT_RANGE]
        self._heated = step.time if len(heat) else None
        assert self._log.grid is not None
        points = rr.Points3D.columns(
            positions=np.column_stack([heat[:, :2], np.full(len(heat), 0.01, np.float32)]),
            colors=palette.WEIGHT_COLOURS[palette.heat_levels(heat[:, 2])],
            radii=np.full(len(heat), self._log.grid.resolution, np.float32),  # to be seen in a whole building
        )
        self._outbox.append((entities.HEAT, timelines([step.index], [step.time]), points.partition([len(heat)])))

    def _log_hindsight(self, poses: NDArray[np.float64]) -> None:
        """The whole path at once, in pieces where it jumps: what hindsight knows, it knows from the start."""
        steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
        pieces = np.split(poses[:, :2], np.flatnonzero(steps > JUMP) + 1)
        strips = [np.column_stack([p, np.full(len(p), 0.025)]) for p in pieces if len(p) > 1]
        self._static(entities.HINDSIGHT, rr.LineStrips3D(strips, colors=[palette.HINDSIGHT] * len(strips)))

    def _static(self, entity: str, *archetypes: Any) -> None:
        self._stream.log(entity, *archetypes, static=True)

    def _document(self, entity: str, markdown: str) -> None:
        self._static(entity, rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN))

    def _property(self, name: str, values: dict[str, Any]) -> None:
        self._stream.send_property(name, rr.AnyValues(**values))

    def _log_map(self, grid: OccupancyGrid) -> None:
        self._static(entities.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        self._static(entities.MAP, drawn_map(grid))
        self._static(entities.CHANGED, rr.Points3D.from_fields(radii=np.float32(0.5 * grid.resolution)))
        area = known_area(grid)
        for entity, bar in scale_bars(area.centre, area.size).items():
            self._static(entity, bar)
        self._static(
            entities.CAMERA,
            rr.Transform3D(translation=[*area.centre, area.height], mat3x3=np.diag([1.0, -1.0, -1.0])),
            rr.Pinhole(
                focal_length=area.height * area.pixels_per_metre,
                resolution=area.pixels,
                camera_xyz=rr.ViewCoordinates.RDF,
                image_plane_distance=0.001,  # the camera itself shall not be seen
            ),
        )

    def _log_styles(self) -> None:
        witnesses = witness_styles(self._wheels) if self._laser else {}
        parts = {} if self._substeps is None else substep_styles()
        told = told_styles(self._truth is not None)
        for entity, archetypes in (styles() | told | witnesses | parts).items():
            self._static(entity, *archetypes)

    def _log_documents(self) -> None:
        log, config = self._log, self._config
        assert log.grid is not None
        found = versions()
        self._property(
            entities.PROPERTY_RUN,
            {
                "log": log.name,
                "log_sha256": log.sha256,
                "map_sha256": log.grid.sha256,
                "scans": len(log),
                "seed": self._seed,
                "config": config.model_dump_json(),
                "versions": json.dumps(found),
            },
        )
        self._document(entities.EXPLANATION, documents.explanation(config, wheels=self._wheels, laser=self._laser))
        self._document(entities.RUN, documents.run(log, config, self._seed, found))
        for entity, chart in logged(self._sensor):
            self._static(entity, chart)
        self._log_sensor_model()

    def _log_sensor_model(self) -> None:
        """What was measured beside the model; before the run, the model alone."""
        if self._sensor.seen:
            self._static(entities.MEASURED, self._sensor.measured())
        self._document(entities.DENSITY_NOTE, documents.sensor_model(self._sensor, self._config))

    def _log_truth(self) -> None:
        if self._truth is None:
            return
        inside, poses, joined = self._truth
        index = timelines(inside, self._log.times[inside])
        self._stream.send_columns(entities.TRUTH, index, transforms(poses, z=0.08))
        self._stream.send_columns(entities.TRUTH_PATH, index, segments(poses, z=0.03, joined=joined))


_NO_PARTICLES = np.empty((0, 3), dtype=np.float32)
_NO_WEIGHTS = np.empty(0, dtype=np.float64)


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else str(value)
