"""What runs tell of themselves where nobody knows the truth: whether seeds agree, what they explain, what they state.

Runs with other random numbers that end up at the same place have each found it anew, so a place at which only some are
is doubtful. That they agree does not prove them right: on the map of another building, or after somebody carried the
robot off, all may be wrong alike. So the probability that they state stands beside it (docs/verdict.md), and
docs/without_truth.md has what all of these figures are on logs whose truth is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.evaluate.metrics import LOCALIZED, Array, Mask
from pipeline.geometry import wrap_angle
from pipeline.judgement.verdict import SURE

if TYPE_CHECKING:
    from pipeline.evaluate.report import Run


@dataclass(frozen=True)
class Told:
    """Means over the scans of some runs, each from 0 to 1.

    ``together``: the share of the other runs that are within 0.5 m and 10 degrees of the one in their middle, None of
    a single run; ``explained``: the share of the beams that the map explains; ``stated``: the probability that the pose
    is right, as the run states it; ``found``: the share of the scans at which that is at least 0.9.
    """

    together: float | None
    explained: float
    stated: float
    found: float


@dataclass(frozen=True)
class Agreement:
    """What the runs on one log tell without a truth, over all scans and over the second half of the log.

    ``middle`` (n, 3): where most of the runs are at every scan, m and rad, the pose of one of them; ``with_middle``
    (runs, n): which of them are within 0.5 m and 10 degrees of it.
    """

    all: Told
    late: Told
    middle: Array
    with_middle: Mask

    def to_dict(self) -> dict[str, Any]:
        """As plain values, without the poses."""
        return {"all": asdict(self.all), "late": asdict(self.late)}


def agreement(runs: Sequence[Run]) -> Agreement:
    """How far runs on one log agree, which all have the same scans."""
    times, poses = runs[0].times, np.stack([run.poses for run in runs])
    middle, with_middle = middles(poses)
    late = times >= times[-1] / 2
    told = [_told(runs, with_middle, scans) for scans in (np.ones_like(late), late)]
    return Agreement(told[0], told[1], middle, with_middle)


def middles(poses: Array) -> tuple[Array, Mask]:
    """Of poses (runs, n, 3), at every scan, the one near which most others are, (n, 3), and which are, (runs, n).

    Near is within 0.5 m and 10 degrees; of several that have as many the one to which the distances add up to least.
    """
    runs, n, _ = poses.shape
    middle, near = np.empty((n, 3)), np.empty((runs, n), np.bool_)
    for k in range(n):
        x, y, yaw = poses[:, k].T
        away = np.hypot(x[:, None] - x, y[:, None] - y)
        close = (away <= LOCALIZED[0]) & (np.abs(wrap_angle(yaw[:, None] - yaw)) <= LOCALIZED[1])
        chosen = np.lexsort((away.sum(axis=1), -close.sum(axis=1)))[0]
        middle[k], near[:, k] = poses[chosen, k], close[chosen]
    return middle, near


def _told(runs: Sequence[Run], with_middle: Mask, scans: Mask) -> Told:
    others = len(runs) - 1
    stated = np.stack([run.probability[scans] for run in runs])
    return Told(
        together=float(np.mean((with_middle[:, scans].sum(axis=0) - 1) / others)) if others else None,
        explained=float(np.mean([run.explained[scans] for run in runs])),
        stated=float(np.mean(stated)),
        found=float(np.mean(stated >= SURE)),
    )
