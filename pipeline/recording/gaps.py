"""When a log says nothing: somebody carried the robot off, or switched it off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

GAP = 5.0  # times the usual interval between scans


def longest_interval(times: NDArray[np.float64]) -> float:
    """Seconds between scans at these times (n,) s above which nothing is known of what was between them."""
    return GAP * float(np.median(np.diff(times))) if len(times) > 1 else np.inf
