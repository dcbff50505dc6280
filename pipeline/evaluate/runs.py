"""Monte Carlo localization, many times over: one run per log and seed, spread over processes."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.evaluate.aftermath import aftermaths
from pipeline.evaluate.failures import RECOVERED, draw_failures
from pipeline.evaluate.kept import Kept, Outcome, source_checksum
from pipeline.evaluate.metrics import LOCALIZED, Array, interpolate, known, laser_to_base, score, search
from pipeline.evaluate.perturbed import UNCHANGED, Change, perturb
from pipeline.evaluate.pool import cores, here, spread
from pipeline.evaluate.report import Evaluation, LogEvaluation, Run, versions
from pipeline.logs.disturbed import disturbed
from pipeline.logs.faults import Fault, noted, placed
from pipeline.logs.messages import Log, Trajectory

if TYPE_CHECKING:
    from pipeline.localization import RunResult


Task = tuple[int, int, int]
"""Index of the configuration, index of the log, and the seed."""


class Runner(Protocol):
    """Localizes one log with one seed on so many threads; a module's function, so that processes can be sent it."""

    def __call__(self, log: Log, config: Config, *, seed: int, threads: int) -> RunResult:
        """Return one row per scan; raise MclError."""
        ...


class Progress(Protocol):
    """Passes items on and shows how many of ``total`` have passed: ``console.progress``."""

    def __call__(self, items: Iterable[Run], total: int, label: str) -> Iterator[Run]:
        """Iterate lazily over the items."""
        ...


@dataclass(frozen=True)
class _Case:
    """A log and what its runs are scored against: ``truth`` (n, 3), NaN where nobody knows it."""

    log: Log
    truth: Array
    kidnapped_at: tuple[float, ...]

    @property
    def scored(self) -> bool:
        """Whether anything of the truth is known."""
        return bool(known(self.truth).any())


@dataclass(frozen=True)
class _Work:
    """All that a process needs to know, once; ``failures`` per metre and ``changes``: one for each of ``configs``."""

    cases: tuple[_Case, ...]
    configs: tuple[Config, ...]
    runner: Runner
    faults: tuple[Fault, ...]
    failures: tuple[float | None, ...]
    changes: tuple[Change | None, ...]
    kept: Kept | None


def evaluate(
    logs: Sequence[Log],
    references: Sequence[Trajectory | None],
    config: Config,
    runs: int = 100,
    jobs: int | None = None,
    first_seed: int = 0,
    progress: Progress | None = None,
    *,
    reference_frame: Literal["base_link", "laser"] = "base_link",
    kidnapped_at: Sequence[float] = (),
    faults: Sequence[Fault] = (),
    failures: float | None = None,
    change: Change | None = None,
    keep: Path | None = None,
    runner: Runner | None = None,
) -> Evaluation:
    """Localize every log with seeds first_seed .. first_seed + runs - 1 and score it against its reference.

    As ``compare`` does, for a single configuration.
    """
    (only,) = compare(
        logs, references, [config], runs, jobs, first_seed, progress,
        reference_frame=reference_frame, kidnapped_at=kidnapped_at, faults=faults, failures=[failures],
        changes=[change], keep=keep, runner=runner,
    )  # fmt: skip
    return only


def compare(
    logs: Sequence[Log],
    references: Sequence[Trajectory | None],
    configs: Sequence[Config],
    runs: int = 100,
    jobs: int | None = None,
    first_seed: int = 0,
    progress: Progress | None = None,
    *,
    reference_frame: Literal["base_link", "laser"] = "base_link",
    kidnapped_at: Sequence[float] = (),
    faults: Sequence[Fault] = (),
    failures: Sequence[float | None] = (),
    changes: Sequence[Change | None] = (),
    keep: Path | None = None,
    runner: Runner | None = None,
) -> tuple[Evaluation, ...]:
    """Localize every log with every configuration, each with seeds first_seed .. first_seed + runs - 1; score all runs.

    ``references``: one per log, poses of ``reference_frame`` in the map frame; None takes the log's own ground truth.
    ``jobs``: processes, one thread each, as many as there are cores if None; 1 stays in this process. The result does
    not depend on it. ``kidnapped_at``: seconds since each log's first scan; none given takes the log's own metadata.
    ``faults`` are made in every log, placed anew by the seed of each run; ``failures``: so many a metre, as
    ``draw_failures`` places them, one number or None for each of ``configs``; ``changes``: how ``perturb`` changes the
    maps, drawn anew by the seed of each run, likewise. ``keep``: a folder in which every finished run is kept, and from
    which it is taken instead of being run again.
    Where neither knows the truth, runs are not scored, and ``agreement`` has what they tell of themselves. Raises
    MclError for a reference that does not overlap the log in time, for faults, failures and changes of the map where
    the truth is not known, and what the runs raise.
    """
    if runs < 1:
        raise MclError(f"runs: expected at least 1, got {runs}")
    if len(references) != len(logs):
        raise MclError(
            f"{len(logs)} logs but {len(references)} references", "give one reference per log, in their order"
        )
    cases = tuple(
        _case(log, reference, reference_frame, kidnapped_at) for log, reference in zip(logs, references, strict=True)
    )
    rates = tuple(failures) or (None,) * len(configs)
    changes = tuple(changes) or (None,) * len(configs)
    kept = None if keep is None else Kept(keep, source_checksum())
    work = _Work(cases, tuple(configs), runner or _localize, tuple(faults), rates, changes, kept)
    _check(work, first_seed)
    seeds = range(first_seed, first_seed + runs)
    tasks: list[Task] = [(c, k, seed) for c in range(len(configs)) for k in range(len(cases)) for seed in seeds]
    jobs = min(jobs or cores(), len(tasks))
    with closing(here(_run, work, tasks) if jobs == 1 else spread(_run, work, tasks, jobs)) as results:
        done = list(progress(results, len(tasks), "evaluating") if progress else results)
    scored = [_scored(case, done[k * runs : (k + 1) * runs]) for k, case in enumerate(cases * len(configs))]
    n = len(cases)
    return tuple(
        Evaluation(tuple(scored[c * n : (c + 1) * n]), config, versions(), rates[c], changes[c])
        for c, config in enumerate(configs)
    )


def _scored(case: _Case, runs: Sequence[Run]) -> LogEvaluation:
    log = case.log
    return LogEvaluation(log.name, log.times, case.truth, case.kidnapped_at, log.grid, tuple(runs))


def _case(log: Log, reference: Trajectory | None, frame: str, kidnapped_at: Sequence[float]) -> _Case:
    if reference is None:
        reference = log.ground_truth
        if reference is None:
            return _Case(log, np.full((len(log), 3), np.nan), ())
    elif frame == "laser":
        reference = laser_to_base(reference, log.laser.pose)
    truth = interpolate(reference, log.stamps)
    if not known(truth).any():
        spans = f"it covers {_span(reference.stamps)}, the log {_span(log.stamps)}"
        raise MclError(f"the reference does not overlap the log in time: {spans}", path=log.path)
    moments = tuple(kidnapped_at) or kidnapped_in(log.metadata)
    try:
        search(log.times, known(truth), known(truth), moments)  # what is wrong with them is known before any run
    except MclError as error:
        raise MclError(error.message, error.hint, path=log.path) from error
    return _Case(log, truth, moments)


def _check(work: _Work, seed: int) -> None:
    """What would be wrong with the faults is known before any run."""
    for case in work.cases:
        if (work.faults or any(work.failures) or any(work.changes)) and not case.scored:
            raise MclError(
                "what is made wrong on purpose is judged by the truth, which this log does not know",
                "give --reference truth.tum", path=case.log.path,
            )  # fmt: skip
        own = noted(case.log.metadata)
        if any(rate is not None for rate in work.failures) and (case.kidnapped_at or own or _jumps(work.faults)):
            hint = "give the log as it was recorded"
            raise MclError("failures are made in a log in which nobody was carried off", hint, path=case.log.path)
        try:
            if work.faults:
                _disturbed(case, work.faults, None, seed)
        except MclError as error:
            raise MclError(error.message, error.hint, path=case.log.path) from error


def _jumps(faults: Sequence[Fault]) -> bool:
    return any(fault.kind == "jump" for fault in faults)


def _disturbed(case: _Case, faults: Sequence[Fault], rate: float | None, seed: int) -> tuple[_Case, tuple[Fault, ...]]:
    """The case as this seed disturbs it, and all the faults that are in it, the log's own before those made here."""
    log, truth, own = case.log, case.truth, noted(case.log.metadata)
    made = placed(faults, log.duration, seed)
    if rate is not None:
        made += draw_failures(log.times, truth, rate, seed)
    if not made:
        return case, own
    carried = [fault.moment for fault in made if fault.carries_off and fault.moment is not None]
    log, rows = disturbed(log, made)
    return _Case(log, truth[rows], (*case.kidnapped_at, *carried)), (*own, *made)


def kidnapped_in(metadata: Mapping[str, Mapping[str, str]]) -> tuple[float, ...]:
    """Seconds that a record of the log's metadata gives under "kidnapped_at", however it separates them."""
    texts = (record.get("kidnapped_at", "") for record in metadata.values())
    return tuple(float(number) for text in texts for number in re.findall(r"[0-9.]+(?:e[-+]?[0-9]+)?", text))


def _span(stamps: NDArray[np.int64]) -> str:
    return f"{stamps[0] / 1e9:.3f} to {stamps[-1] / 1e9:.3f} s" if len(stamps) else "nothing"


# --- one run ------------------------------------------------------------------------------------------------------


def _localize(log: Log, config: Config, *, seed: int, threads: int) -> RunResult:
    from pipeline.localization import localize  # here, so that a process sets its threads before it meets numba

    return localize(log, config, seed=seed, threads=threads)


def _run(work: _Work, task: Task) -> Run:
    config, rate, seed = work.configs[task[0]], work.failures[task[0]], task[2]
    case, faults = _disturbed(work.cases[task[1]], work.faults, rate, seed)
    case, changed = _changed(case, config, work.changes[task[0]], seed)
    result = _outcome(work, case.log, config, seed, throwaway=bool(changed))
    scored = None
    if case.scored:
        scored = score(
            case.log.times,
            result.poses,
            case.truth,
            kidnapped_at=case.kidnapped_at,
            lost_at=result.lost_at.tolist(),
            hindsight=result.hindsight,
            weights=result.weights,
        )
    times, limits = case.log.times, LOCALIZED if rate is None else RECOVERED
    return Run(
        seed,
        scored,
        result.poses,
        result.seconds,
        speed=case.log.duration / result.elapsed,
        times=times,
        truth=case.truth,
        probability=result.probability,
        covariances=result.covariances,
        explained=result.explained,
        map_changed=changed,
        faults=aftermaths(times, result.poses, case.truth, faults, limits) if case.scored else (),
    )


def _outcome(work: _Work, log: Log, config: Config, seed: int, throwaway: bool) -> Outcome:
    """What the runner says, now or when it was kept; ``throwaway``: nobody will want this map's table again."""
    key = None if work.kept is None else work.kept.key(log, config, seed, work.runner)
    if work.kept is not None and key is not None and (found := work.kept.read(key)) is not None:
        return found
    from pipeline.maps.range_table import throwaway_tables  # here, for the same reason

    with throwaway_tables() if throwaway else nullcontext():
        start = time.perf_counter()
        result = work.runner(log, config, seed=seed, threads=1)
        outcome = Outcome.of(result, time.perf_counter() - start)
    if work.kept is not None and key is not None:
        work.kept.write(key, outcome)
    return outcome


def _changed(case: _Case, config: Config, change: Change | None, seed: int) -> tuple[_Case, float | None]:
    """The case with the map as this seed changes it, and how much of the seen wall that really is."""
    if change is None:
        return case, None
    log = case.log
    if change.kind == UNCHANGED or log.grid is None:
        return case, 0.0
    try:
        made = perturb(log.grid, case.truth, log.laser, config, change, seed)
    except MclError as error:
        raise MclError(error.message, error.hint, path=log.path) from error
    return replace(case, log=replace(log, grid=made.grid)), made.changed
