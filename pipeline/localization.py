"""THE loop: a log and a configuration in, a belief per scan out, and whoever wants to see it may look."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.filter.step import Event, Step
from pipeline.logs.messages import Log, Scan, Trajectory

if TYPE_CHECKING:
    from pipeline.judgement.verdict import Kind
    from pipeline.world.seen import Seen


class Sink(Protocol):
    """Something that looks at every step: a recording, a test, a live plot."""

    def log(self, step: Step) -> None:
        """Take note of a step; its arrays are valid until the next one."""


@dataclass(frozen=True)
class RunResult:
    """What a run found, one row per scan: stamps (n,) int64 ns; poses (n, 3) m, m, rad in the map frame, online.

    ``events``: (scan index, seconds since the first scan, event); ``seconds``: wall time by part; ``particles``,
    ``ess``, ``mean_likelihood``, ``explained``, ``spread`` (n,); ``weights`` (n,): the estimate's share of the belief;
    ``covariances`` (n, 3, 3): of the poses, x, y, yaw;
    ``converged_at``: seconds, None if it never did; ``verdicts``: on every scan, in words; ``probability`` (n,): that
    the pose is right; ``seen``: what the log has shown of the world, by itself, None if nothing was remembered;
    ``hindsight`` (n, 3): as ``poses``, told from the end of the log.
    """

    stamps: NDArray[np.int64]
    poses: NDArray[np.float64]
    events: tuple[tuple[int, float, Event], ...]
    seconds: dict[str, float]
    particles: NDArray[np.int64]
    ess: NDArray[np.float64]
    mean_likelihood: NDArray[np.float64]
    explained: NDArray[np.float64]
    spread: NDArray[np.float64]
    weights: NDArray[np.float64]
    covariances: NDArray[np.float64]
    probability: NDArray[np.float64]
    verdicts: tuple[Kind, ...]
    converged_at: float | None = None
    seen: Seen | None = None
    hindsight: NDArray[np.float64] | None = None

    @property
    def trajectory(self) -> Trajectory:
        """The online estimate as a trajectory in the map frame."""
        return Trajectory(self.stamps, self.poses)


def localize(
    log: Log,
    config: Config,
    *,
    seed: int = 0,
    threads: int | None = None,
    sinks: Sequence[Sink] = (),
    progress: Callable[[Iterable[Scan]], Iterable[Scan]] = iter,
    seen: Seen | None = None,
) -> RunResult:
    """Run Monte Carlo localization over a log; the same log, config and seed give the same result at any ``threads``.

    ``seen``: what earlier runs on this map have shown of the world, to begin with.

    Raises MclError if the log has no map, or the map no room for a robot.
    """
    if log.grid is None:
        raise MclError("the log has no map", "give one with --map", path=log.path)
    if len(log) == 0:
        raise MclError("the log has no scans", path=log.path)
    grid, log = log.grid, log.without_short(config.laser_min_range)
    config = config.model_copy(update={"laser_max_range": log.laser.longest(config.laser_max_range)})
    # Imported here: numba takes longer to load than a short log to localize, and --help must not wait for it.
    from pipeline.filter.told_filter import filter_of
    from pipeline.kernels.threads import use_threads

    clock = _Clock()
    with use_threads(threads):
        mcl = filter_of(config)(grid, log.laser, config, seed, wheels=log.wheels, seen=seen)
        clock.lap("start")
        steps = _Columns(len(log))
        for scan in progress(log.scans()):
            step = mcl.update(scan)
            clock.lap("filter")
            for sink in sinks:
                sink.log(step)
            steps.log(step)
            clock.lap("record")
        hindsight = mcl.hindsight.trajectory(seed)
        clock.lap("hindsight")
    return steps.result(log, clock.seconds, hindsight, _of_log(log, mcl.finish()))


def _of_log(log: Log, seen: Seen | None) -> Seen | None:
    return None if seen is None else dataclasses.replace(seen, logs=(log.sha256,))


class _Columns:
    """Collects from every step what a RunResult keeps."""

    def __init__(self, n: int) -> None:
        self._poses = np.empty((n, 3))
        self._figures = np.empty((n, 6))
        self._covariances = np.empty((n, 3, 3))
        self._probability = np.empty(n)
        self._verdicts: list[Kind] = []
        self._events: list[tuple[int, float, Event]] = []
        self._rows = 0

    def log(self, step: Step) -> None:
        self._poses[self._rows] = step.estimate.pose
        self._figures[self._rows] = (
            len(step.particles), step.ess, step.mean_likelihood, step.explained, step.spread, step.estimate.weight,
        )  # fmt: skip
        self._covariances[self._rows] = step.estimate.covariance
        self._probability[self._rows] = step.verdict.probability
        self._verdicts.append(step.verdict.kind)
        self._events += [(step.index, step.time, event) for event in step.events]
        self._rows += 1

    def result(
        self, log: Log, seconds: dict[str, float], hindsight: NDArray[np.float64] | None, seen: Seen | None
    ) -> RunResult:
        particles, ess, mean_likelihood, explained, spread, weights = self._figures.T.copy()
        converged = [t for _, t, event in self._events if event.kind == "converged"]
        return RunResult(
            stamps=log.stamps,
            poses=self._poses,
            events=tuple(self._events),
            seconds=seconds,
            particles=particles.astype(np.int64),
            ess=ess,
            mean_likelihood=mean_likelihood,
            explained=explained,
            spread=spread,
            weights=weights,
            covariances=self._covariances,
            probability=self._probability,
            verdicts=tuple(self._verdicts),
            seen=seen,
            converged_at=converged[0] if converged else None,
            hindsight=hindsight,
        )


class _Clock:
    """Adds up wall time by part."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, part: str) -> None:
        now = time.perf_counter()
        self.seconds[part] = self.seconds.get(part, 0.0) + now - self._last
        self._last = now
