"""Loops over arrays, compiled by numba: arrays and scalars in, arrays out, nothing of ours imported.

Every kernel has a slow, obvious twin in ``tests/reference.py``. Two decorators, so that flags live in one place:
``kernel`` for a single thread, and ``paired`` for a loop over particles that comes in two forms, since waking the
threads costs more than moving 500 particles does.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any

# Threads that wait shall sleep. Where other programs want the cores too, a thread that spins takes the time of the one
# that it waits for: a run then took four times as long. Read once, when numba loads the library of its threads.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
# But not at once: the next loop often comes within the 20 us that this many rounds take (GNU's library).
os.environ.setdefault("GOMP_SPINCOUNT", "10000")

from numba import njit
from numba.np import linalg


def _spare_scipy() -> None:
    """Keeps numba from loading all of scipy.linalg (0.15 s) only to see whether BLAS is there.

    It asks when it loads its array functions, at the first compilation of anything. Who multiplies matrices in a
    kernel, which none of ours does, loads scipy then.
    """
    ask = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        linalg.ensure_blas = ask


_spare_scipy()

# fastmath may reorder sums and drop NaN checks; only "contract" (a * b + c in one instruction) is safe for results
# that must be equal on every run, and NaN and inf are handled before the kernels.
kernel = njit(cache=True, nogil=True, fastmath={"contract"})
inline = njit(cache=True, nogil=True, fastmath={"contract"}, inline="always")
_parallel = njit(cache=True, nogil=True, parallel=True, fastmath={"contract"})


BLOCK = 1024
"""Particles that are looked at together: what is kept of them fits the first cache. Sums are made block by block, and
the blocks' sums added in order, so that no number of threads changes a bit."""


class paired:  # noqa: N801  (a decorator)
    """A loop written once with ``prange``, compiled for one thread and for all; ``(work, *args)`` chooses.

    ``work`` is the number of inner operations; below ``PARALLEL_WORK`` a single thread is quicker. Each iteration
    writes its own outputs only, so both forms give the same bytes.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.serial = kernel(function)
        # numba's cache on disk knows functions by name, not by flags: under one name the form compiled first would
        # be loaded for both.
        name, defaults = f"{function.__name__}_parallel", function.__defaults__
        twin = FunctionType(function.__code__, function.__globals__, name, defaults)
        twin.__module__, twin.__qualname__ = function.__module__, twin.__name__
        self.parallel = _parallel(twin)
        self.__doc__ = function.__doc__
        self.__name__ = function.__name__
        self.__module__ = function.__module__

    def __call__(self, work: int, *args: Any) -> Any:
        """Run with one thread or with all, as the amount of work deserves."""
        return (self.parallel if work >= PARALLEL_WORK else self.serial)(*args)


PARALLEL_WORK = 500_000
"""About half a millisecond: less is not worth the wait for threads that a busy machine may have put aside."""


def compiled() -> bool:
    """Whether an earlier run has left compiled kernels beside the sources (numba's cache)."""
    return any((Path(__file__).parent / "__pycache__").glob("*.nbi"))
