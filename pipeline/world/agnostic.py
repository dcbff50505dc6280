"""What a reading is worth where nobody knows what the laser should see: as much as the log's own readings on average.

A reading from land that the map does not know can be anything that this laser reads in this building; how often it
reads what, the log says. A right place on the map explains its beams better than that, a wrong one worse.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BINS = 32
"""Of equal width, from 0 to the longest range."""
SOME = 200.0
"""Beams, spread evenly over all ranges, that stand for what is known before the first scan."""
PARTLY = 0.02
"""Share of readings without return among them."""


class Agnostic:
    """Counts the readings of a log, and says how probable each is without knowing where it was taken."""

    def __init__(self, max_range: float) -> None:
        self._width = max_range / BINS
        self._counts = np.full(BINS, SOME * (1.0 - PARTLY) / BINS)
        self._none = SOME * PARTLY

    def learn(self, ranges: NDArray[np.float32]) -> None:
        """Count the readings (k,) of a scan: m, inf = no return, NaN = invalid, which says nothing."""
        back = ranges[np.isfinite(ranges)]
        self._counts += np.bincount(self._bins(back), minlength=BINS)
        self._none += np.count_nonzero(np.isinf(ranges))

    def density(self, ranges: NDArray[np.float32]) -> NDArray[np.float64]:
        """(k,) per metre, of readings that came back; the probability of none where none did; 1 where invalid."""
        total = self._counts.sum() + self._none
        back = np.isfinite(ranges)
        out = np.where(np.isnan(ranges), 1.0, self._none / total)
        out[back] = self._counts[self._bins(ranges[back])] / (total * self._width)
        return out

    def survival(self, far: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) how probable it is that a reading is longer than each of ``far`` (n,) m, or never comes back."""
        total = self._counts.sum() + self._none
        edges = np.arange(BINS + 1) * self._width
        return 1.0 - np.interp(far, edges, np.append(0.0, np.cumsum(self._counts))) / total

    def _bins(self, ranges: NDArray[np.float32]) -> NDArray[np.int64]:
        return np.clip((ranges / self._width).astype(np.int64), 0, BINS - 1)
