"""What a recording says about its run, read back from the .rrd alone and without a viewer."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.judgement.verdict import KINDS
from pipeline.logs.messages import Trajectory
from pipeline.logs.tum import write_tum
from pipeline.recording import entities
from pipeline.recording.gaps import longest_interval
from pipeline.recording.rrd_file import RrdFile, read_rrd
from pipeline.recording.run_folder import RECORDING
from pipeline.recording.statements import Statements

NAMED = 8
"""Runs of a folder that are named."""


class SeveralRunsError(MclError):
    """A recording of several runs side by side, where that of one was wanted."""


@dataclass(frozen=True)
class EntityInfo:
    """``rows`` are points in time (1 for what never changes); ``bytes`` are unpacked, in memory."""

    path: str
    rows: int
    bytes: int


@dataclass(frozen=True)
class RecordedEvent:
    """Something that happened: at which scan, seconds since the first one, and what."""

    scan: int
    time: float
    kind: str
    level: str
    text: str


@dataclass(frozen=True)
class RecordedPose:
    """An estimate in the map frame, m and rad: ``stamp`` in ns, ``time`` in s since the first scan."""

    scan: int
    stamp: int
    time: float
    x: float
    y: float
    yaw: float
    sigma_x: float
    sigma_y: float
    sigma_yaw: float
    verdict: str | None
    probability: float | None


@dataclass(frozen=True)
class Inspection:
    """A run as its recording tells it; what a damaged recording lost is empty or None.

    ``log_scans``: scans in the log, of which ``scans`` were recorded; ``duration``: seconds from the first to the
    last of these; ``timings``: wall seconds by part; ``figures``: what the run said at its end; ``damage``: one
    line, empty if the file is whole. ``stamps`` (n,) int64 ns, ``times`` (n,) s, ``poses`` (n, 3) float64 in the
    map frame, ``covariances`` (n, 3, 3); ``statements``: what wheels and laser said of the way;
    ``verdicts`` (n,) indices into ``judgement.verdict.KINDS``, ``probabilities`` (n,) of the estimates being right.
    """

    path: Path
    recording_id: str
    damage: str
    log: str
    log_sha256: str
    map_sha256: str
    log_scans: int
    seed: int
    config: Mapping[str, Any]
    versions: Mapping[str, str]
    started: str
    timings: Mapping[str, float]
    figures: Mapping[str, Any]
    entities: tuple[EntityInfo, ...]
    events: tuple[RecordedEvent, ...]
    scan_indices: NDArray[np.int64]
    stamps: NDArray[np.int64]
    times: NDArray[np.float64]
    poses: NDArray[np.float64]
    covariances: NDArray[np.float64]
    statements: Statements
    verdicts: NDArray[np.int64]
    probabilities: NDArray[np.float64]

    def __repr__(self) -> str:
        return f"Inspection({str(self.path)!r}: {self.log}, seed {self.seed}, {self.scans:,} scans)"

    @property
    def scans(self) -> int:
        """How many scans were recorded."""
        return len(self.stamps)

    @property
    def duration(self) -> float:
        """Seconds from the first recorded scan to the last."""
        return float(self.times[-1] - self.times[0]) if self.scans else 0.0

    @cached_property
    def converged_at(self) -> float | None:
        """Seconds since the first scan when the belief first converged, or None."""
        return next((event.time for event in self.events if event.kind == "converged"), None)

    @property
    def trajectory(self) -> Trajectory:
        """The estimate at every scan, to full precision."""
        return Trajectory(self.stamps, self.poses)

    def pose_at(self, time: float) -> RecordedPose:
        """The estimate in force ``time`` seconds after the first scan: that of the last scan until then."""
        if not self.scans:
            raise MclError("the recording holds no scans", path=self.path)
        first, last = float(self.times[0]), float(self.times[-1])
        if not first <= time <= last:
            raise MclError(f"no estimate at {time:g} s", f"the recording runs from {first:g} s to {last:g} s")
        row = int(np.searchsorted(self.times, time, side="right")) - 1
        sigmas = np.sqrt(np.maximum(np.diagonal(self.covariances[row]), 0.0))
        x, y, yaw, sigma_x, sigma_y, sigma_yaw = (float(v) for v in (*self.poses[row], *sigmas))
        scan, stamp, at = int(self.scan_indices[row]), int(self.stamps[row]), float(self.times[row])
        judged = len(self.probabilities) > row
        verdict = KINDS[self.verdicts[row]] if judged else None
        probability = float(self.probabilities[row]) if judged else None
        return RecordedPose(scan, stamp, at, x, y, yaw, sigma_x, sigma_y, sigma_yaw, verdict, probability)

    def gap_at(self, time: float) -> tuple[float, float] | None:
        """From when to when, in seconds, there is no scan at ``time``; None if it lies among the others."""
        after = int(np.searchsorted(self.times, time, side="right"))
        if not 0 < after < self.scans:
            return None
        begin, end = float(self.times[after - 1]), float(self.times[after])
        return (begin, end) if begin < time and end - begin > longest_interval(self.times) else None

    def to_dict(self) -> dict[str, Any]:
        """Everything but the poses, as JSON-like values."""
        return {
            "path": str(self.path),
            "recording_id": self.recording_id,
            "damage": self.damage or None,
            "log": self.log,
            "log_sha256": self.log_sha256,
            "map_sha256": self.map_sha256,
            "seed": self.seed,
            "scans": self.scans,
            "log_scans": self.log_scans,
            "duration": self.duration,
            "converged_at": self.converged_at,
            "started": self.started or None,
            "timings": dict(self.timings),
            "figures": dict(self.figures),
            "versions": dict(self.versions),
            "config": dict(self.config),
            "events": [asdict(event) for event in self.events],
            "entities": [asdict(entity) for entity in self.entities],
        }

    def summary_rows(self) -> list[tuple[str, str]]:
        """The facts about the run as (name, value) texts, for a table."""
        converged = "never" if self.converged_at is None else f"{self.converged_at:.1f} s"
        scans = f"{self.scans}" if self.scans == self.log_scans else f"{self.scans} of {self.log_scans}"
        rows = [
            ("log", self.log),
            ("scans", scans),
            ("duration", f"{self.duration:.1f} s"),
            ("seed", str(self.seed)),
            ("converged", converged),
            *self._verdict_rows(),
            *((f"time: {name}", f"{seconds:.2f} s") for name, seconds in self.timings.items()),
            *((name, version) for name, version in self.versions.items()),
            ("recording", self.recording_id),
            ("started", self.started),
        ]
        return [*rows, ("damage", self.damage)] if self.damage else rows

    def _verdict_rows(self) -> list[tuple[str, str]]:
        if not len(self.verdicts):
            return []
        shares = np.bincount(self.verdicts, minlength=len(KINDS)) / len(self.verdicts)
        said = ", ".join(f"{kind} {100 * share:.0f} %" for kind, share in zip(KINDS, shares, strict=True) if share)
        last = f"{KINDS[self.verdicts[-1]]}, right with probability {self.probabilities[-1]:.2f}"
        return [("scans by verdict", said), ("at the end", last)]

    def entity_rows(self) -> list[tuple[str, str, str]]:
        """Entities as (path, rows, bytes) texts."""
        return [(entity.path, f"{entity.rows:,}", f"{entity.bytes:,}") for entity in self.entities]

    def event_rows(self) -> list[tuple[str, str, str, str]]:
        """Events as (time, scan, kind, text) texts."""
        return [(f"{e.time:.1f} s", str(e.scan), e.kind, e.text) for e in self.events]


def inspect(path: Path | str) -> Inspection:
    """Read a recording, given as the .rrd or as the folder of a run; a damaged one as far as it goes.

    Raises MclError if there is no recording, or not one of this project's.
    """
    return inspect_file(*open_recording(path))


def open_recording(path: Path | str) -> tuple[Path, RrdFile]:
    """The recording of a run's folder, or the .rrd itself: its path, and its chunks. Raises MclError as `inspect`."""
    path = Path(path)
    path = _recording_in(path) if path.is_dir() else path
    return path, read_rrd(path)


def inspect_file(path: Path, file: RrdFile) -> Inspection:
    """What these chunks of the recording at ``path`` tell. Raises MclError if they are not this project's."""
    tables = _tables(file)
    run = _properties(tables, entities.PROPERTY_RUN)
    if file.application_id == entities.SEVERAL_ID:
        raise SeveralRunsError("this recording shows several runs side by side", "name the runs themselves", path=path)
    if file.application_id != entities.APPLICATION_ID or not run:
        raise MclError(
            "this recording was not written by `mcl`", f"its application is {file.application_id!r}", path=path
        )
    record = _sorted_rows(tables.get(entities.RECORD), entities.SCAN)
    stamps = _numbers(record, f"{entities.RECORD_TYPE}:stamp", np.int64)
    started, timings = _timings(tables.get(entities.TIMINGS))
    return Inspection(
        path=path,
        recording_id=file.recording_id,
        damage=file.damage,
        log=run["log"],
        log_sha256=run["log_sha256"],
        map_sha256=run["map_sha256"],
        log_scans=int(run["scans"]),
        seed=int(run["seed"]),
        config=json.loads(run["config"]),
        versions=json.loads(run["versions"]),
        started=started,
        timings=timings,
        figures=json.loads(_properties(tables, entities.PROPERTY_RESULT).get("figures", "{}")),
        entities=_entities(file),
        events=_events(tables.get(entities.EVENTS)),
        scan_indices=_index(record, entities.SCAN),
        stamps=stamps,
        times=_index(record, entities.TIME) / 1e9,
        poses=_numbers(record, f"{entities.RECORD_TYPE}:pose", np.float64).reshape(-1, 3),
        covariances=_numbers(record, f"{entities.RECORD_TYPE}:covariance", np.float64).reshape(-1, 3, 3),
        statements=Statements(file.chunks),
        verdicts=_numbers_if_there(record, f"{entities.RECORD_TYPE}:verdict", np.int64),
        probabilities=_numbers_if_there(record, f"{entities.RECORD_TYPE}:probability", np.float64),
    )


def export_trajectory(path: Path | str, output: Path | str) -> Trajectory:
    """Write a recording's trajectory in TUM format, byte for byte what the run wrote beside it, and return it.

    Raises MclError if ``output`` exists.
    """
    output = Path(output)
    if output.exists():
        raise MclError("this file exists already", "name another one", path=output)
    trajectory = inspect(path).trajectory
    write_tum(output, trajectory)
    return trajectory


def _recording_in(folder: Path) -> Path:
    """The recording of a run's folder; if it is a folder of such folders instead, MclError names them."""
    if (folder / RECORDING).exists():
        return folder / RECORDING
    found = [*folder.glob(f"*/{RECORDING}"), *folder.glob(f"*/*/{RECORDING}")]
    runs = [str(p.parent) for p in sorted(found, key=lambda p: (p.stat().st_mtime_ns, p), reverse=True)]
    if not runs:
        raise MclError(f"no run's folder: there is no {RECORDING} in it", path=folder)
    more = f" and {len(runs) - NAMED} more" if len(runs) > NAMED else ""
    several = f"{len(runs)} runs, newest first" if len(runs) > 1 else "one run"
    hint = "name one of them" if len(runs) > 1 else "name that one"
    raise MclError(f"holds {several}: {', '.join(runs[:NAMED])}{more}", hint, path=folder)


def _tables(file: RrdFile) -> dict[str, pa.Table]:
    # An entity's static and temporal chunks, and those with other columns, have other schemas: missing becomes null.
    batches: dict[str, list[Any]] = defaultdict(list)
    wanted = (entities.RECORD, entities.EVENTS, entities.TIMINGS, "/__properties/")
    for chunk in file.chunks:
        if chunk.entity_path.startswith(wanted):
            batches[chunk.entity_path].append(
                pa.Table.from_batches([chunk.to_record_batch()]).replace_schema_metadata()
            )
    return {entity: pa.concat_tables(found, promote_options="default") for entity, found in batches.items()}


def _entities(file: RrdFile) -> tuple[EntityInfo, ...]:
    rows: dict[str, int] = defaultdict(int)
    sizes: dict[str, int] = defaultdict(int)
    for chunk in file.chunks:
        rows[chunk.entity_path] += 0 if chunk.is_static else chunk.num_rows
        sizes[chunk.entity_path] += chunk.to_record_batch().nbytes
    return tuple(EntityInfo(path, max(rows[path], 1), sizes[path]) for path in sorted(sizes))


def _properties(tables: Mapping[str, pa.Table], name: str) -> dict[str, Any]:
    table = tables.get(f"/__properties/{name}")
    if table is None:
        return {}
    return {column: _first(table[column]) for column in table.column_names if not column.startswith("rerun.")}


def _events(table: pa.Table | None) -> tuple[RecordedEvent, ...]:
    table = _sorted_rows(table, entities.SCAN)
    if table is None:
        return ()
    names = (f"{entities.EVENT_TYPE}:kind", "TextLog:level", "TextLog:text")
    kinds, levels, texts = ([row[0] for row in table[name].to_pylist()] for name in names)
    scans, times = _index(table, entities.SCAN), _index(table, entities.TIME) / 1e9
    columns: Iterable[Any] = zip(scans.tolist(), times.tolist(), kinds, levels, texts, strict=True)
    return tuple(RecordedEvent(*row) for row in columns)


def _timings(table: pa.Table | None) -> tuple[str, dict[str, float]]:
    if table is None:
        return "", {}
    _, *names = (row[0] for row in table[f"{entities.TIMING_TYPE}:name"].to_pylist())
    clock = table[entities.LOG_TIME].cast(pa.int64()).to_numpy()
    started = str(np.datetime64(int(clock[0]), "ns").astype("datetime64[s]")) + "Z"
    return started, dict(zip(names, (np.diff(clock) / 1e9).tolist(), strict=True))


def _sorted_rows(table: pa.Table | None, timeline: str) -> pa.Table | None:
    """Rows in order of the timeline; a file may hold its chunks in any order. Rows of equal time keep theirs."""
    if table is None or timeline not in table.column_names:
        return None
    order = np.argsort(table[timeline].cast(pa.int64()).to_numpy(), kind="stable")
    return table.take(pa.array(order))


def _index(table: pa.Table | None, timeline: str) -> NDArray[np.int64]:
    return np.empty(0, np.int64) if table is None else table[timeline].cast(pa.int64()).to_numpy()


def _numbers(table: pa.Table | None, column: str, kind: type[Any]) -> NDArray[Any]:
    if table is None:
        return np.empty(0, kind)
    return table[column].combine_chunks().flatten().to_numpy(zero_copy_only=False).astype(kind, copy=False)


def _numbers_if_there(table: pa.Table | None, column: str, kind: type[Any]) -> NDArray[Any]:
    """As ``_numbers``; none from a recording of an earlier version, which has no such column."""
    return _numbers(table if table is not None and column in table.column_names else None, column, kind)


def _first(column: Any) -> Any:
    value = column[0].as_py()
    return value[0] if isinstance(value, list) else value
