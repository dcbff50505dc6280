"""Tasks one after the other in this process, or spread over several that end when it does, however it ends."""

from __future__ import annotations

import os
import pickle
import shutil
import signal
import tempfile
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.connection import wait
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from pipeline.errors import MclError

Work = TypeVar("Work")
Task = TypeVar("Task")
Result = TypeVar("Result")


def here(run: Callable[[Work, Task], Result], work: Work, tasks: Sequence[Task]) -> Generator[Result, None, None]:
    """The results of the tasks, one after the other."""
    for task in tasks:
        yield run(work, task)


def spread(
    run: Callable[[Work, Task], Result], work: Work, tasks: Sequence[Task], jobs: int
) -> Generator[Result, None, None]:
    """The results in the order of the tasks, from so many processes; ``run`` is a module's function.

    Whatever ends this early, Ctrl-C too, ends the processes at once. They end as well, and take the folder with what
    they need along, when this process is killed without a chance to do anything. Raises MclError if one of them dies.
    """
    others = active_children()
    with TemporaryDirectory(prefix="mcl-evaluate-") as folder:
        # By file: the logs are written once, and no process waits for the one before it to have read them.
        file = Path(folder) / "work.pickle"
        file.write_bytes(pickle.dumps((run, work)))
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


_started: tuple[Callable[[Any, Any], Any], Any] | None = None


def _start(file: Path) -> None:
    """What a process does first: one thread for numba, a watch on its parent, then the work into memory."""
    global _started
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ["NUMBA_NUM_THREADS"] = "1"
    tempfile.tempdir = str(file.parent)  # what it leaves behind goes with the folder
    threading.Thread(target=_end_with_parent, args=(file.parent,), daemon=True).start()
    _started = pickle.loads(file.read_bytes())


def _end_with_parent(folder: Path) -> None:
    """A parent that is killed closes nothing and removes nothing: whoever outlives it does."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(1)


def _run_started(task: Any) -> Any:
    assert _started is not None
    run, work = _started
    return run(work, task)


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
