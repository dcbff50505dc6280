"""THE loop: a log and a configuration in, a belief per scan out, and whoever wants to see it may look."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.data_frame import data_frame
from pipeline.errors import MclError
from pipeline.filter.step import Event, Step
from pipeline.logs.messages import Log, Scan, Trajectory

if TYPE_CHECKING:
    import pandas as pd

    from pipeline.filter.substeps import SubSteps
    from pipeline.judgement.verdict import Kind
    from pipeline.world.seen import Seen


class Sink(Protocol):
    """Something that looks at every step: a recording, a test, a live plot."""

    def log(self, step: Step) -> None:
        """Take note of a step; its arrays are its own and read-only, and no later step changes them."""


@dataclass(frozen=True)
class RunResult:
    """What a run found, one row per scan: stamps (n,) int64 ns; poses (n, 3) m, m, rad in the map frame, online.

    ``log``, ``config``, ``seed``: what was run. ``events``: (scan index, seconds since the first scan, event);
    ``seconds``: wall time by part; ``particles``, ``ess``, ``mean_likelihood``, ``explained``, ``spread`` (n,);
    ``weights`` (n,): the estimate's share of the belief; ``covariances`` (n, 3, 3): of the poses, x, y, yaw;
    ``converged_at``: seconds, None if it never did; ``verdicts``: on every scan, in words; ``probability`` (n,): that
    the pose is right; ``seen``: what the log has shown of the world, by itself, None if nothing was remembered;
    ``hindsight`` (n, 3): as ``poses``, told from the end of the log.
    """

    log: Log
    config: Config
    seed: int
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

    @property
    def times(self) -> NDArray[np.float64]:
        """Seconds since the log's first scan, (n,)."""
        return self.log.times[: len(self.stamps)]

    def __len__(self) -> int:
        return len(self.stamps)

    def __repr__(self) -> str:
        return f"RunResult({self.log.name!r}, seed {self.seed}: {'; '.join(self._facts())})"

    def _repr_html_(self) -> str:
        from pipeline.maps.picture import css, figure, map_svg
        from pipeline.recording import palette

        assert self.log.grid is not None
        truth = self.log.ground_truth
        paths = [("where it was", truth.poses, css(palette.TRUTH))] if truth is not None else []
        paths.append(("where it was believed to be", self.poses, css(palette.ESTIMATE)))
        return figure(map_svg(self.log.grid, paths), repr(self))

    def _facts(self) -> list[str]:
        seconds = float(self.stamps[-1] - self.stamps[0]) / 1e9 if len(self) else 0.0
        facts = [f"{len(self):,} scans in {seconds:.1f} s"]
        if len(self):
            x, y, yaw = self.poses[-1]
            facts += [
                "never converged" if self.converged_at is None else f"converged at {self.converged_at:.1f} s",
                f"ends at ({x:.2f}, {y:.2f}) m, {np.degrees(yaw):.0f} deg",
                f"{self.verdicts[-1]} with probability {self.probability[-1]:.2f}",
            ]
        return facts

    def to_pandas(self) -> pd.DataFrame:
        """A row per scan: stamp (ns), time (s), the pose (m, rad) with the deviations of its covariance, in hindsight
        too if that was asked for; verdict, probability, weight, explained, particles, ess, mean_likelihood, spread.

        Raises MclError without pandas.
        """
        deviations = np.sqrt(np.maximum(np.diagonal(self.covariances, axis1=1, axis2=2), 0.0))
        names = ("x", "y", "yaw")
        columns: dict[str, Any] = {"stamp": self.stamps, "time": self.times}
        columns |= {name: self.poses[:, k] for k, name in enumerate(names)}
        columns |= {f"sigma_{name}": deviations[:, k] for k, name in enumerate(names)}
        if self.hindsight is not None:
            columns |= {f"hindsight_{name}": self.hindsight[:, k] for k, name in enumerate(names)}
        columns |= {"verdict": self.verdicts, "probability": self.probability, "weight": self.weights}
        for name in ("explained", "particles", "ess", "mean_likelihood", "spread"):
            columns[name] = getattr(self, name)
        return data_frame(columns)


class Localizer:
    """Monte Carlo localization over a log, one scan at a time: whoever iterates over it gets a Step for every scan.

    The loop may stop wherever it likes and go on later, with another one. ``finish`` tells what was found until then.
    The same log, config and seed give the same steps at any ``threads`` (all cores if None), and those of ``localize``.
    ``seen``: what earlier runs on this map have shown of the world, to begin with. ``substeps``: is told what happens
    within the updates, which changes no result.
    Every step has arrays of its own: those of a belief of 100,000 particles take 2 MB for as long as somebody keeps it.

    Raises MclError if the log has no map or no scans, the map no room for a robot, or its filter no sub-steps to tell.
    """

    def __init__(
        self,
        log: Log,
        config: Config | None = None,
        *,
        seed: int = 0,
        threads: int | None = None,
        seen: Seen | None = None,
        substeps: SubSteps | None = None,
    ) -> None:
        if log.grid is None:
            raise MclError("the log has no map", "give one with --map", path=log.path)
        if len(log) == 0:
            raise MclError("the log has no scans", path=log.path)
        self.log, self.config, self.seed = log, Config() if config is None else config, seed
        self._threads = threads
        grid, log = log.grid, log.without_short(self.config.laser_min_range)
        config = self.config.model_copy(update={"laser_max_range": log.laser.longest(self.config.laser_max_range)})
        # Imported here: numba takes longer to load than a short log to localize, and --help must not wait for it.
        from pipeline.filter.told_filter import filter_of
        from pipeline.kernels.threads import use_threads

        self._clock = _Clock()
        self._use_threads = use_threads
        with use_threads(threads):
            self._filter = filter_of(config)(grid, log.laser, config, seed, wheels=log.wheels, seen=seen)
            if substeps is not None:
                self._filter.watch(substeps)
        self._clock.lap("start")
        self._scans = log.scans()
        self._steps = _Columns(len(log))
        self._result: RunResult | None = None

    def __repr__(self) -> str:
        done = f"{self._steps.rows:,} of {len(self.log):,} scans done"
        return f"Localizer({self.log.name!r}, seed {self.seed}: {done})"

    def __iter__(self) -> Iterator[Step]:
        """The steps of the scans that are left, until the log ends or ``finish`` is called."""
        for scan in self._scans:
            if self._result is not None:
                return
            yield self._update(scan).own()
            self._clock.skip()

    def finish(self) -> RunResult:
        """What was found in the scans until now; no more steps come after it. Raises MclError before the first one."""
        if self._steps.rows == 0:
            raise MclError("no scan has been localized yet", "iterate over the Localizer first", path=self.log.path)
        if self._result is None:
            self._clock.skip()
            with self._use_threads(self._threads):
                hindsight = self._filter.hindsight.trajectory(self.seed)
                self._clock.lap("hindsight")
                seen = _of_log(self.log, self._filter.finish())
            self._result = self._steps.result(self, dict(self._clock.seconds), hindsight, seen)
        return self._result

    def _update(self, scan: Scan) -> Step:
        """The filter's own step, whose arrays its next one changes."""
        with self._use_threads(self._threads):
            step = self._filter.update(scan)
        self._steps.log(step)
        self._clock.lap("filter")
        return step


def localize(
    log: Log,
    config: Config | None = None,
    *,
    seed: int = 0,
    threads: int | None = None,
    sinks: Sequence[Sink] = (),
    progress: Callable[[Iterable[Scan]], Iterable[Scan]] = iter,
    seen: Seen | None = None,
    substeps: SubSteps | None = None,
) -> RunResult:
    """Run Monte Carlo localization over a log; the same log, config and seed give the same result at any ``threads``.

    ``config``: every parameter's default if None. ``sinks`` are shown every step. ``seen``: what earlier runs on this
    map have shown of the world, to begin with. ``substeps``: is told what happens within the updates, which changes no
    result.

    Raises MclError if the log has no map, or the map no room for a robot, or its filter has no sub-steps to tell of.
    """
    run = Localizer(log, config, seed=seed, threads=threads, seen=seen, substeps=substeps)
    for scan in progress(run._scans):
        step = run._update(scan)
        step = step.own() if sinks else step
        for sink in sinks:
            sink.log(step)
        run._clock.lap("record")
    return run.finish()


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
        self.rows = 0

    def log(self, step: Step) -> None:
        self._poses[self.rows] = step.estimate.pose
        self._figures[self.rows] = (
            len(step.particles), step.ess, step.mean_likelihood, step.explained, step.spread, step.estimate.weight,
        )  # fmt: skip
        self._covariances[self.rows] = step.estimate.covariance
        self._probability[self.rows] = step.verdict.probability
        self._verdicts.append(step.verdict.kind)
        self._events += [(step.index, step.time, event) for event in step.events]
        self.rows += 1

    def result(
        self, run: Localizer, seconds: dict[str, float], hindsight: NDArray[np.float64] | None, seen: Seen | None
    ) -> RunResult:
        n = self.rows
        particles, ess, mean_likelihood, explained, spread, weights = self._figures[:n].T.copy()
        converged = [t for _, t, event in self._events if event.kind == "converged"]
        return RunResult(
            log=run.log,
            config=run.config,
            seed=run.seed,
            stamps=run.log.stamps[:n],
            poses=self._poses[:n],
            events=tuple(self._events),
            seconds=seconds,
            particles=particles.astype(np.int64),
            ess=ess,
            mean_likelihood=mean_likelihood,
            explained=explained,
            spread=spread,
            weights=weights,
            covariances=self._covariances[:n],
            probability=self._probability[:n],
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

    def skip(self) -> None:
        """What was done since the last lap is no part of the run."""
        self._last = time.perf_counter()
