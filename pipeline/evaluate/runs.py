"""Monte Carlo localization, many times over: one run per log and seed, spread over processes."""

from __future__ import annotations

import os
import pickle
import re
import signal
import threading
import time
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import dataclass
from multiprocessing import active_children, get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.evaluate.aftermath import aftermaths
from pipeline.evaluate.failures import RECOVERED, draw_failures
from pipeline.evaluate.metrics import LOCALIZED, Array, interpolate, known, laser_to_base, score, search
from pipeline.evaluate.report import Evaluation, LogEvaluation, Run, versions
from pipeline.filter.step import TAKEOVERS
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
    """A log and what its runs are scored against."""

    log: Log
    truth: Array
    kidnapped_at: tuple[float, ...]


@dataclass(frozen=True)
class _Work:
    """All that a process needs to know, once; ``failures``: per metre, one for each of ``configs``."""

    cases: tuple[_Case, ...]
    configs: tuple[Config, ...]
    runner: Runner
    faults: tuple[Fault, ...]
    failures: tuple[float | None, ...]


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
    runner: Runner | None = None,
) -> Evaluation:
    """Localize every log with seeds first_seed .. first_seed + runs - 1 and score it against its reference.

    As ``compare`` does, for a single configuration.
    """
    (only,) = compare(
        logs, references, [config], runs, jobs, first_seed, progress,
        reference_frame=reference_frame, kidnapped_at=kidnapped_at, faults=faults, failures=[failures], runner=runner,
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
    runner: Runner | None = None,
) -> tuple[Evaluation, ...]:
    """Localize every log with every configuration, each with seeds first_seed .. first_seed + runs - 1; score all runs.

    ``references``: one per log, poses of ``reference_frame`` in the map frame; None takes the log's own ground truth.
    ``jobs``: processes, one thread each, as many as there are cores if None; 1 stays in this process. The result does
    not depend on it. ``kidnapped_at``: seconds since each log's first scan; none given takes the log's own metadata.
    ``faults`` are made in every log, placed anew by the seed of each run; ``failures``: so many a metre, as
    ``draw_failures`` places them, one number or None for each of ``configs``.
    Raises MclError for a log without reference, a reference that does not overlap it in time, and what the runs raise.
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
    work = _Work(cases, tuple(configs), runner or _localize, tuple(faults), rates)
    _check(work, first_seed)
    seeds = range(first_seed, first_seed + runs)
    tasks: list[Task] = [(c, k, seed) for c in range(len(configs)) for k in range(len(cases)) for seed in seeds]
    jobs = min(jobs or _cores(), len(tasks))
    with closing(_here(work, tasks) if jobs == 1 else _pool(work, tasks, jobs)) as results:
        done = list(progress(results, len(tasks), "evaluating") if progress else results)
    scored = [_scored(case, done[k * runs : (k + 1) * runs]) for k, case in enumerate(cases * len(configs))]
    n = len(cases)
    return tuple(
        Evaluation(tuple(scored[c * n : (c + 1) * n]), config, versions(), rates[c]) for c, config in enumerate(configs)
    )


def _scored(case: _Case, runs: Sequence[Run]) -> LogEvaluation:
    log = case.log
    return LogEvaluation(log.name, log.times, case.truth, case.kidnapped_at, log.grid, tuple(runs))


def _case(log: Log, reference: Trajectory | None, frame: str, kidnapped_at: Sequence[float]) -> _Case:
    if reference is None:
        reference = log.ground_truth
        if reference is None:
            raise MclError("the log has no ground truth to score against", "give --reference truth.tum", path=log.path)
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
    start = time.perf_counter()
    result = work.runner(case.log, config, seed=seed, threads=1)
    elapsed = time.perf_counter() - start
    scored = score(
        case.log.times,
        result.poses,
        case.truth,
        kidnapped_at=case.kidnapped_at,
        lost_at=[index for index, _, event in result.events if event.kind in TAKEOVERS],
        hindsight=result.hindsight,
        weights=result.weights,
    )
    times, limits = case.log.times, LOCALIZED if rate is None else RECOVERED
    return Run(
        seed,
        scored,
        result.poses,
        dict(result.seconds),
        speed=case.log.duration / elapsed,
        times=times,
        truth=case.truth,
        faults=aftermaths(times, result.poses, case.truth, faults, limits),
    )


# --- here, or in a pool of processes --------------------------------------------------------------------------------


def _here(work: _Work, tasks: Sequence[Task]) -> Generator[Run, None, None]:
    for task in tasks:
        yield _run(work, task)


def _pool(work: _Work, tasks: Sequence[Task], jobs: int) -> Generator[Run, None, None]:
    """The runs in the order of the tasks. Whatever ends this early, Ctrl-C too, ends the processes at once."""
    others = active_children()
    with TemporaryDirectory(prefix="mcl-evaluate-") as folder:
        # By file: the logs are written once, and no process waits for the one before it to have read them.
        file = Path(folder) / "work.pickle"
        file.write_bytes(pickle.dumps(work))
        # Spawned, not forked: a fork copies the locks of numba's and rich's threads without the threads.
        pool = ProcessPoolExecutor(jobs, get_context("spawn"), initializer=_start, initargs=(file,))
        try:
            with _without_interrupts():
                futures = [pool.submit(_run_started, task) for task in tasks]
            for future in futures:
                yield future.result()
        except BrokenProcessPool as error:
            hint = "it may have run out of memory: fewer --jobs, or a smaller max_particles"
            raise MclError("a process of the evaluation died", hint) from error
        except BaseException:
            # The executor ends what is left when it sees its processes die. Cancelled futures would make it stumble.
            for child in active_children():
                if child not in others:
                    child.terminate()
            raise
        finally:
            pool.shutdown()


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Processes started meanwhile inherit deaf ears for Ctrl-C: their parent hears it, and ends them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)


_started: _Work | None = None


def _start(file: Path) -> None:
    """What a process does first: one thread for numba, then the work into memory."""
    global _started
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ["NUMBA_NUM_THREADS"] = "1"
    _started = pickle.loads(file.read_bytes())


def _run_started(task: Task) -> Run:
    assert _started is not None
    return _run(_started, task)


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
