"""One whole run: localize a log, record it, score it against its truth, and leave everything in a run's own folder."""

from __future__ import annotations

import shlex
import shutil
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from pipeline.config import Config, dump_config, load_config
from pipeline.errors import MclError
from pipeline.evaluate.judged import score_run
from pipeline.evaluate.metrics import Score
from pipeline.filter.step import Step
from pipeline.filter.substeps import SubSteps
from pipeline.judgement.verdict import KINDS, TRUSTED
from pipeline.localization import RunResult, Sink, localize
from pipeline.logs.messages import Log, Scan, Trajectory
from pipeline.logs.tum import write_tum
from pipeline.motion.faults import KINDS as FAULTS
from pipeline.parts.sinks import OwnSink
from pipeline.recording.run_folder import RunFolder, create
from pipeline.recording.sampling import draw

if TYPE_CHECKING:
    from pathlib import Path

    from pipeline.logs.result import ResultFile
    from pipeline.recording.rerun_sink import RerunSink
    from pipeline.world.seen import Seen

HINDSIGHT = "trajectory_hindsight.tum"
PLACES = 5
"""Places that a diagnosis names."""


class Progress(Protocol):
    """Passes the scans on and shows how many of ``total`` have passed: ``console.progress``."""

    def __call__(self, items: Iterable[Scan], total: int, label: str) -> Iterator[Scan]:
        """Iterate lazily over the scans."""
        ...


@dataclass(frozen=True)
class Replay:
    """What a run left and how it went: ``score`` is None where the log does not know the truth.

    ``began_with``: the memory of earlier runs, if any; ``seconds``: wall time by part; ``recorded``: whether the folder
    holds a recording.
    """

    folder: RunFolder
    log: Log
    seed: int
    result: RunResult
    began_with: Seen | None
    score: Score | None
    seconds: dict[str, float]
    recorded: bool

    def __repr__(self) -> str:
        return f"Replay({str(self.folder.path)!r}: {self.result!r})"

    @property
    def speed(self) -> float:
        """Seconds of log per second of wall clock."""
        return self.log.duration / sum(self.seconds.values())

    @property
    def explained(self) -> float:
        """Share of the beams that the map explains at the estimate, from convergence on (if it came) to the end."""
        return _explained(self.log, self.result)

    @property
    def found_at_end(self) -> bool:
        """Whether the last scan's pose can be trusted."""
        return self.result.verdicts[-1] in TRUSTED

    @property
    def known_late(self) -> float:
        """Share of the scans in the second half of the run that are found, or off the map and known to be there.

        By then a robot that can be found is; on the map of another building none of them was (docs/verdict.md).
        """
        late = self.log.times >= self.log.duration / 2
        known = np.array([kind in TRUSTED for kind in self.result.verdicts])
        return float(np.mean(known[late]))

    @property
    def explained_late(self) -> float:
        """Share of the beams that the map explains at the estimate, over the second half of the run.

        By then a robot that can be found is: what explains little is no map of where it was.
        """
        return _explained_late(self.log, self.result)

    def to_dict(self) -> dict[str, Any]:
        """As plain values: what ``run.json`` holds."""
        from pipeline.recording.versions import versions

        grid = self.log.grid
        return {
            "log": {
                "name": self.log.name,
                "path": str(self.log.path),
                "sha256": self.log.sha256,
                "map_sha256": None if grid is None else grid.sha256,
                "scans": len(self.log),
                "duration": self.log.duration,
            },
            "seed": self.seed,
            "figures": _figures(self.log, self.result),
            "memory": {
                "began_with_logs": [] if self.began_with is None else list(self.began_with.logs),
                "cells_changed": None if self.result.seen is None else int(np.count_nonzero(self.result.seen.changed)),
            },
            "truth": None if self.score is None else self.score.to_dict(),
            "seconds": self.seconds,
            "speed": self.speed,
            "versions": versions(),
        }


def replay(
    log: Log,
    config: Config,
    folder: RunFolder,
    *,
    seed: int = 0,
    threads: int | None = None,
    record: bool = True,
    progress: Progress | None = None,
    given: Sequence[str] = (),
    mcap: Path | None = None,
    viewer: str | None = None,
    seen: Seen | None = None,
    passes: int = 1,
    own_sinks: Sequence[str] = (),
    substeps: tuple[float, float] | None = None,
) -> Replay:
    """Localize the log and fill the folder: configuration, recording (if ``record``), trajectories, figures, memory.

    ``seen``: what earlier runs on this map have shown of the world. ``passes``: how often the log is gone through, each
    time with the memory of the times before; the last one is recorded.

    ``mcap``: a file to write as well, the result beside the log's messages; a run that is stopped leaves none.
    ``viewer``: the address of a viewer that shows the recording while it grows. ``own_sinks``: names of parts of the
    user's own that look at every step as well. ``substeps``: seconds since the first scan between which the recording
    has the parts of each update as well.
    ``given``: options of `mcl localize` by which the log was read, to be repeated by whoever repeats the run.
    Whatever ends the run early, the recording is closed and can be read as far as it went. But where the input
    is to blame (MclError), or no scan was recorded, nothing can be learnt from it, and the folder is removed.
    """
    recorded = _Count()
    try:
        if log.grid is None:  # the recording would miss it first, and cannot say how to give one
            raise MclError("the log has no map", "give one with --map", path=log.path)
        if substeps is not None and not ((log.times >= substeps[0]) & (log.times <= substeps[1])).any():
            between = " and ".join(f"{moment:g} s" for moment in substeps)
            raise MclError(f"there is no scan between {between}", f"it lasts {log.duration:.1f} s", path=log.path)
        folder.write_config(config, _how_to_repeat(log, folder, seed, given))
        with ExitStack() as stack:
            recordings: list[RerunSink] = []
            opening = 0.0
            if record:
                from pipeline.recording.rerun_sink import RerunSink

                begun = time.perf_counter()
                sink = RerunSink(
                    folder.recording, log=log, config=config, seed=seed, viewer=viewer,
                    substeps=substeps is not None,
                )  # fmt: skip
                recordings = [stack.enter_context(sink)]
                opening = time.perf_counter() - begun
            sinks: list[Sink] = [*recordings, recorded] if record else []
            if mcap is not None:
                sinks.append(_Published(stack.enter_context(_result_file(mcap, log, config, seed)), config, seed))
            offered = {"grid": log.grid, "laser": log.laser, "config": config}
            sinks += [stack.enter_context(OwnSink(name, **offered)) for name in own_sinks]
            began_with = seen
            others = None if seen is None or log.sha256 in seen.logs else seen
            for number in range(1, passes):
                watched = _watched(log, progress, f"pass {number} of {passes}")
                last = localize(log, config, seed=seed, threads=threads, progress=watched, seen=seen).seen
                seen = _together(last, others)
            watched = _watched(log, progress, "localizing" if passes == 1 else f"pass {passes} of {passes}")
            parts = None if substeps is None or not record else SubSteps(log, *substeps, sink.log_substep)
            result = localize(
                log, config, seed=seed, threads=threads, sinks=sinks, progress=watched, seen=seen, substeps=parts
            )  # fmt: skip
            done = time.perf_counter()
            for recording in recordings:
                recording.finish({"timings": result.seconds, **_figures(log, result)}, result.hindsight)
        recorded_in = opening + result.seconds["record"]
        seconds = result.seconds | {"record": recorded_in, "close": time.perf_counter() - done}
    except BaseException as error:
        if isinstance(error, MclError) or not recorded.steps:
            shutil.rmtree(folder.path)
        raise
    run = Replay(folder, log, seed, result, began_with, _score(result), seconds, record)
    folder.write_trajectory(result.trajectory)
    if result.hindsight is not None:
        write_tum(folder.path / HINDSIGHT, Trajectory(result.stamps, result.hindsight))
    if (memory := _together(result.seen, others)) is not None:
        memory.write(folder.memory)
    folder.write_run(run.to_dict())
    return run


def record_run(
    log: Log,
    config: Config | None = None,
    output: Path | str | None = None,
    *,
    seed: int = 0,
    threads: int | None = None,
) -> Replay:
    """Localize a log and leave a run's folder, as `mcl localize` does: recording, trajectories, figures, memory.

    ``output``: the folder, which must not exist or be empty; ``recordings/<log>/<date and time>`` if None. What is in
    it is read back by ``read_run``. Raises MclError as ``replay``, and where the folder holds something.
    """
    folder = create(log.name, output)
    return replay(log, config or load_config(), folder, seed=seed, threads=threads)


def _how_to_repeat(log: Log, folder: RunFolder, seed: int, given: Sequence[str]) -> list[str]:
    command = ["mcl", "localize", str(log.path), *given, "--config", str(folder.config), "--seed", str(seed)]
    return [f"{log.name}, seed {seed}. The same run again:", f"  {shlex.join(command)}", ""]


def _result_file(path: Path, log: Log, config: Config, seed: int) -> ResultFile:
    from pipeline.logs.result import ResultFile

    return ResultFile(path, log, {"seed": str(seed), "config": dump_config(config)})


class _Published:
    """Writes every step into an .mcap, with the particles that a recording would show."""

    def __init__(self, file: ResultFile, config: Config, seed: int) -> None:
        self._file, self._at_most, self._seed = file, config.record_particles, seed

    def log(self, step: Step) -> None:
        drawn = draw(len(step.particles), self._at_most, self._seed, step.index)
        weights = np.exp(step.log_weights[drawn])
        shares = weights / weights.sum() if len(drawn) else weights
        estimate = step.estimate
        self._file.write(step.index, estimate.pose, estimate.covariance, step.particles[drawn], shares)
        self._file.diagnose(step.index, step.verdict.kind, _diagnosis(step))


def _diagnosis(step: Step) -> dict[str, str]:
    """What a robot's monitor shows of a step, in texts."""
    figures = {
        "probability of being right": step.verdict.probability,
        "share of the belief": step.estimate.weight,
        "beams explained": step.explained,
        "beams short of what is mapped": step.short,
        "beams behind what is mapped": step.through,
        "belief off the map": step.off_map,
    }
    places = [
        f"{100 * cluster.weight:.0f} % at ({cluster.pose[0]:.2f}, {cluster.pose[1]:.2f})"
        for cluster in step.clusters[:PLACES]
    ]
    return {name: f"{value:.3f}" for name, value in figures.items()} | {"places": "; ".join(places)}


def _together(own: Seen | None, others: Seen | None) -> Seen | None:
    """What this log has shown and what others have: of a log that had been seen before only what it shows now."""
    return own if own is None or others is None else own.merged(others)


class _Count:
    """How many steps the sinks before it have taken."""

    def __init__(self) -> None:
        self.steps = 0

    def log(self, _: Step) -> None:
        self.steps += 1


def _watched(log: Log, progress: Progress | None, label: str) -> Any:
    return iter if progress is None else lambda scans: progress(scans, len(log), label)


def _figures(log: Log, result: RunResult) -> dict[str, Any]:
    """What came out, the same on every machine: times are of the log, not of the wall clock."""
    return {
        "scans": len(log),
        "duration": log.duration,
        "converged_at": result.converged_at,
        "end_pose": result.poses[-1].tolist(),
        "explained": _explained(log, result),
        "explained_late": _explained_late(log, result),
        "particles": int(result.particles[-1]),
        "verdict": _verdict(log, result),
        "faults": [
            {"time": time, "kind": event.kind, "text": event.text}
            for _, time, event in result.events
            if event.kind in ("gap", *FAULTS)
        ],
    }


def _verdict(log: Log, result: RunResult) -> dict[str, Any]:
    """What can be trusted: at the end, in which share of the scans, and from when on which verdict held."""
    kinds = result.verdicts
    began = [k for k in range(len(kinds)) if k == 0 or kinds[k] != kinds[k - 1]]
    return {
        "at_end": kinds[-1],
        "probability": float(result.probability[-1]),
        "shares": {kind: kinds.count(kind) / len(kinds) for kind in KINDS},
        "since": [{"time": float(log.times[k]), "verdict": kinds[k]} for k in began],
    }


def _explained(log: Log, result: RunResult) -> float:
    since = 0.0 if result.converged_at is None else result.converged_at
    return float(np.mean(result.explained[log.times >= since]))


def _explained_late(log: Log, result: RunResult) -> float:
    return float(np.mean(result.explained[log.times >= log.duration / 2]))


def _score(result: RunResult) -> Score | None:
    if result.log.ground_truth is None:
        return None
    try:
        return score_run(result)
    except MclError:
        return None  # a truth that says nothing of the log, or of a whole stretch, is no reason to lose the run
