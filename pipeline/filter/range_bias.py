"""By how much the laser's ranges exceed the map's: known from the start, or learned on the way."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config

NEAR = 0.4
"""Metres: only beams that end this close to the expected range say something of the bias."""
RATE = 0.004
"""Metres per scan at which the bias can follow: slow beside a corridor, quick beside a log."""
LARGEST = 0.4


class RangeBias:
    """The bias, in metres: ``config.range_bias`` if given; else it starts at ``half_thickness`` of the map's walls, and
    moves towards the median residual by stochastic approximation (Robbins and Monro): up where more beams end beyond
    the expected range than before it, down otherwise."""

    def __init__(self, config: Config, half_thickness: float) -> None:
        self._learns = config.range_bias is None
        self.value = min(half_thickness, LARGEST) if config.range_bias is None else config.range_bias

    def learn(self, measured: NDArray[np.float32], expected: NDArray[np.float32]) -> None:
        """Take in the beams (k,) m of an estimate that is trusted; ``measured`` already has the bias taken off."""
        if not self._learns:
            return
        both = np.isfinite(measured) & np.isfinite(expected)
        residual = measured[both] - expected[both]
        residual = residual[np.abs(residual) < NEAR]
        if len(residual):
            step = RATE * float(np.mean(np.sign(residual)))
            self.value = min(max(self.value + step, -LARGEST), LARGEST)
