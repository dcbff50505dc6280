"""What the scans say for one place against another, where the map is known to be wrong in places."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SPOT = 2.0
"""Metres. A spot is a square with so much wall: where the map is wrong, all beams that end there are misled."""
MOST_PER_SPOT = 1.0
"""Nats by which one spot may speak for one place against another."""
FAMILIAR = 2.0
"""Independent beams that must have ended on a spot until half of what they say is believed."""


class Evidence:
    """Accounts of several contenders for being the right place; row 0 is the belief's.

    Beams that end on the same spot err together, in all the scans that see it: a door that was shut since the map was
    made misleads for as long as it is in view. So however many they are, they count as one: their mean. Spots are told
    apart in the frame of the odometry, which all contenders share, and which holds for as long as a contest lasts.
    """

    def __init__(self) -> None:
        self._slot_of_spot: dict[tuple[int, int, bool], int] = {}
        # (contenders, spots): log-likelihood, and the beams that it is the sum of.
        self._sums, self._beams = np.zeros((1, 256)), np.zeros((1, 256))
        self._leads: NDArray[np.float64] | None = None

    def admit(self, newcomers: int) -> None:
        """So many contenders join, with the account of the belief: what was before tells nothing about them."""
        self._leads = None
        self._sums = np.vstack([self._sums, np.repeat(self._sums[:1], newcomers, axis=0)])
        self._beams = np.vstack([self._beams, np.zeros((newcomers, self._beams.shape[1]))])

    def keep(self, rows: NDArray[np.int64]) -> None:
        """Only these contenders stay, in this order; the first is the belief."""
        self._leads = None
        self._sums, self._beams = self._sums[rows], self._beams[rows]

    def enter(
        self, log_likelihood: NDArray[np.float64], ends: NDArray[np.float64], at: NDArray[np.float64], weight: float
    ) -> None:
        """Book the log-likelihood (contenders, k) of each beam on the spot where it ended.

        ``ends`` (k, 2) m in the odometry frame, NaN where nothing came back: such a beam is booked on the patch
        of floor that it was sent from, ``at`` (2,). ``weight``: of a beam, for how many independent ones it counts.
        """
        self._leads = None
        back = np.isfinite(ends[:, 0])
        cells = np.floor(np.where(back[:, None], ends, at) / SPOT).astype(np.int64)
        spots = zip(*cells.T.tolist(), back.tolist(), strict=True)
        slots = np.array([self._slot_of_spot.setdefault(spot, len(self._slot_of_spot)) for spot in spots])
        while len(self._slot_of_spot) > self._sums.shape[1]:
            self._sums = np.hstack([self._sums, np.zeros_like(self._sums)])
            self._beams = np.hstack([self._beams, np.zeros_like(self._beams)])
        contenders, width = self._sums.shape
        at_row = slots + width * np.arange(contenders)[:, None]
        sums = np.bincount(at_row.ravel(), log_likelihood.ravel(), minlength=contenders * width)
        self._sums += weight * sums.reshape(contenders, width)
        self._beams += weight * np.bincount(slots, minlength=width)

    def leads(self) -> NDArray[np.float64]:
        """(contenders,) nats by which each is ahead of the belief, whose own lead is 0."""
        if self._leads is None:
            self._leads = self._reckoned()
        return self._leads

    def _reckoned(self) -> NDArray[np.float64]:
        used = len(self._slot_of_spot)
        ahead, beams = self._sums[:, :used] - self._sums[0, :used], self._beams[:, :used]
        mean = np.clip(ahead / np.maximum(beams, 1e-9), -MOST_PER_SPOT, MOST_PER_SPOT)
        leads: NDArray[np.float64] = (mean * beams / (beams + FAMILIAR)).sum(axis=1)
        return leads
