"""How good a trajectory is against a reference: arrays in, numbers out.

A run is judged in *stretches*: the whole log, or, where the robot was kidnapped, the time up to the first
kidnapping and from each kidnapping to the next. Within a stretch the robot counts as found at the earliest scan
that is localized and from which on at least 95 % of the scans are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.geometry import Pose, compose, inverse, wrap_angle
from pipeline.logs.messages import Trajectory

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LOCALIZED = (0.5, np.radians(10.0))  # m, rad: closer than this is localized
END = (1.0, np.radians(20.0))  # m, rad: a run that succeeds ends closer than this
CERTAIN = 0.9  # of the belief
LOCALIZED_SHARE = 0.95  # of the scans from the one at which the robot counts as found


# --- the reference ------------------------------------------------------------------------------------------------


def laser_to_base(reference: Trajectory, laser: Pose) -> Trajectory:
    """base_link's trajectory from the laser's: every pose (+) the inverse of ``laser``, its place in base_link."""
    return Trajectory(reference.stamps, compose(reference.poses, inverse(laser)), reference.frame)


def interpolate(reference: Trajectory, stamps: NDArray[np.int64]) -> Array:
    """Poses of the reference at ``stamps`` (int64 ns): linear in x and y, along the shortest angle in yaw.

    Returns (n, 3) metres and radians; NaN outside the reference's span. Gaps are bridged however long they are:
    references leave out the time in which the robot stood still.
    """
    poses = np.full((len(stamps), 3), np.nan)
    if len(reference.stamps) == 0:
        return poses
    inside = (stamps >= reference.stamps[0]) & (stamps <= reference.stamps[-1])
    # Nanoseconds since 1970 do not fit a float64; nanoseconds since the reference's start do.
    knots = (reference.stamps - reference.stamps[0]).astype(np.float64)
    at = (stamps[inside] - reference.stamps[0]).astype(np.float64)
    yaw = np.unwrap(reference.poses[:, 2])
    columns = (reference.poses[:, 0], reference.poses[:, 1], yaw)
    poses[inside] = np.stack([np.interp(at, knots, column) for column in columns], axis=-1)
    poses[:, 2] = wrap_angle(poses[:, 2])
    return poses


# --- errors -------------------------------------------------------------------------------------------------------


def pose_errors(poses: Array, truth: Array) -> tuple[Array, Array]:
    """Distance |p - p*| in m and |yaw - yaw*| on the circle in rad, each (n,), of poses (n, 3) from truth (n, 3)."""
    position = np.hypot(poses[:, 0] - truth[:, 0], poses[:, 1] - truth[:, 1])
    return position, np.abs(wrap_angle(poses[:, 2] - truth[:, 2]))


def is_localized(position: Array, heading: Array) -> Mask:
    """Where the position error is at most 0.5 m and the heading error at most 10 degrees; errors (n,) in m and rad."""
    return np.logical_and(position <= LOCALIZED[0], heading <= LOCALIZED[1])


def found_at(localized: Mask) -> int | None:
    """The earliest i with localized[i] and mean(localized[i:]) >= 95 %; None if there is none."""
    remaining = np.arange(len(localized), 0, -1)
    good = np.cumsum(localized[::-1])[::-1]
    found = np.flatnonzero(localized & (good >= LOCALIZED_SHARE * remaining))
    return int(found[0]) if len(found) else None


def rmse(errors: Array) -> float | None:
    """sqrt(mean(e^2)), in the unit of the errors (n,); of positions without alignment it is the ATE. None if n = 0."""
    return float(np.sqrt(np.mean(np.square(errors)))) if len(errors) else None


@dataclass(frozen=True)
class Summary:
    """Median, 95th percentile (linear interpolation) and root mean square of some numbers, in their own unit."""

    median: float
    p95: float
    rmse: float

    @classmethod
    def of(cls, values: Array | Sequence[float]) -> Summary | None:
        """The summary of values (n,); None if n = 0."""
        array = np.asarray(values, dtype=np.float64)
        if not len(array):
            return None
        median, p95 = np.percentile(array, [50, 95])
        return cls(float(median), float(p95), float(np.sqrt(np.mean(array**2))))


def wilson_interval(successes: int, trials: int, z: float = 1.959964) -> tuple[float, float]:
    """Wilson's score interval of a success rate, 95 % by default.

    (p + z^2/2n -+ z sqrt(p(1-p)/n + z^2/4n^2)) / (1 + z^2/n); unlike the normal approximation it stays
    within [0, 1] and is honest at 0 and n successes.
    """
    if trials == 0:
        return 0.0, 1.0
    p, scale = successes / trials, 1 + z * z / trials
    centre = (p + z * z / (2 * trials)) / scale
    half = z / scale * sqrt(p * (1 - p) / trials + z * z / (4 * trials * trials))
    # Exactly 0 and 1 at the ends, where rounding would leave 1e-17.
    return (0.0 if successes == 0 else centre - half), (1.0 if successes == trials else centre + half)


def known(truth: Array) -> Mask:
    """Rows of truth (n, 3) that say where the robot was, (n,)."""
    return np.logical_not(np.isnan(truth).any(axis=1))


def search(
    times: Array, localized: Mask, scored: Mask, kidnapped_at: Sequence[float] = ()
) -> tuple[list[float | None], Mask]:
    """Seconds from each stretch's start until the robot was found (None: never), and the scored scans since then, (n,).

    ``times``: (n,) seconds since the first scan; ``localized``, ``scored``: (n,); ``kidnapped_at``: seconds.
    Raises MclError for a stretch without a scored scan and for a kidnapping outside the log.
    """
    since_found = np.zeros(len(times), dtype=np.bool_)
    found: list[float | None] = []
    for start, stretch in _stretches(times, scored, kidnapped_at):
        first = found_at(localized[stretch])
        found.append(None if first is None else float(times[stretch[first]]) - start)
        if first is not None:
            since_found[stretch[first:]] = True
    return found, since_found


# --- the score of a run -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Recovery:
    """What followed the kidnapping ``kidnapped_at`` seconds into the log: recovered ``time`` seconds later, or None."""

    kidnapped_at: float
    time: float | None

    @property
    def recovered(self) -> bool:
        """Localized for at least 95 % of the scans from some scan on, until the next kidnapping or the end."""
        return self.time is not None


@dataclass(frozen=True)
class Score:
    """One run against the reference: metres, degrees, seconds; None where there is nothing to measure.

    ``success``: found in every stretch, and within 1.0 m and 20 degrees at the last scan. ``time_to_localize``: from
    the log's first scan to the one at which the robot counts as found. ``localized``, ``localized_after``: share of
    scans localized, of all and of those since it was found. ``certain_at``: from the log's first scan to the first that
    is localized and has 90 % of the belief there; None also where the belief is not told. ``position_error``,
    ``heading_error``: since it was found.
    ``ate``: RMSE of the position over all scans; ``ate_after``: since it was found. ``end_*``: at the last scan.
    ``false_alarms``: takeovers just after a scan that was localized, unless somebody carried the robot off between the
    two: a right one mends the estimate at once.
    ``hindsight_*``: of the trajectory smoothed afterwards: errors at the first scan, and RMSE over all. ``scored``:
    scans within the reference's span.
    """

    success: bool
    time_to_localize: float | None
    localized: float
    localized_after: float | None
    position_error: Summary | None
    heading_error: Summary | None
    ate: float | None
    ate_after: float | None
    end_position_error: float
    end_heading_error: float
    recoveries: tuple[Recovery, ...]
    false_alarms: int
    hindsight_start_position_error: float | None
    hindsight_start_heading_error: float | None
    hindsight_ate: float | None
    scored: int
    certain_at: float | None = None

    @property
    def scans_right(self) -> float:
        """Share of all scans, from the log's first one on, at which the online pose was right: ``localized``."""
        return self.localized

    def to_dict(self) -> dict[str, Any]:
        """As plain values, ready for JSON."""
        recoveries = [asdict(r) | {"recovered": r.recovered} for r in self.recoveries]
        return asdict(self) | {"scans_right": self.scans_right, "recoveries": recoveries}


def score(
    times: Array,
    poses: Array,
    truth: Array,
    *,
    kidnapped_at: Sequence[float] = (),
    lost_at: Sequence[int] = (),
    hindsight: Array | None = None,
    weights: Array | None = None,
) -> Score:
    """Score the poses (n, 3) of a run against truth (n, 3), both base_link in the map frame, m and rad.

    ``times``: (n,) seconds since the first scan; rows of ``truth`` that are NaN are not scored. ``kidnapped_at``: in s.
    ``lost_at``: indices of the scans at which the filter said that it was lost; ``hindsight``: (n, 3) or None;
    ``weights``: (n,) each pose's share of the belief, or None.
    Raises MclError where no scan can be scored, in the whole log or in a stretch.
    """
    scored = known(truth)
    position, heading = pose_errors(poses, truth)
    localized = is_localized(position, heading)
    found, since_found = search(times, localized, scored, kidnapped_at)
    certain = np.flatnonzero(localized & (weights >= CERTAIN)) if weights is not None else np.zeros(0, np.int64)
    last = int(np.flatnonzero(scored)[-1])
    smoothed = pose_errors(hindsight[scored], truth[scored]) if hindsight is not None else None
    return Score(
        success=None not in found and bool(position[last] <= END[0] and heading[last] <= END[1]),
        time_to_localize=found[0],
        localized=float(np.mean(localized[scored])),
        localized_after=float(np.mean(localized[since_found])) if since_found.any() else None,
        position_error=Summary.of(position[since_found]),
        heading_error=Summary.of(np.degrees(heading[since_found])),
        ate=rmse(position[scored]),
        ate_after=rmse(position[since_found]),
        end_position_error=float(position[last]),
        end_heading_error=float(np.degrees(heading[last])),
        recoveries=tuple(Recovery(at, time) for at, time in zip(sorted(kidnapped_at), found[1:], strict=True)),
        false_alarms=sum(bool(localized[k - 1]) and not _carried(times, k, kidnapped_at) for k in lost_at if k > 0),
        hindsight_start_position_error=float(smoothed[0][0]) if smoothed else None,
        hindsight_start_heading_error=float(np.degrees(smoothed[1][0])) if smoothed else None,
        hindsight_ate=rmse(smoothed[0]) if smoothed else None,
        scored=int(np.sum(scored)),
        certain_at=float(times[certain[0]]) if len(certain) else None,
    )


def _carried(times: Array, scan: int, kidnapped_at: Sequence[float]) -> bool:
    """Whether somebody carried the robot off between a scan and the one before."""
    return any(times[scan - 1] < at <= times[scan] for at in kidnapped_at)


def _stretches(times: Array, scored: Mask, kidnapped_at: Sequence[float]) -> list[tuple[float, NDArray[np.int64]]]:
    """Start in seconds and indices of the scored scans, of each stretch."""
    if not scored.any():
        raise MclError("the reference covers none of the scans")
    for at in kidnapped_at:
        if not 0.0 < at <= times[-1]:
            raise MclError(f"kidnapped at {at:g} s: the log runs from 0 to {times[-1]:g} s")
    starts = [0.0, *sorted(kidnapped_at)]
    which = np.searchsorted(starts, times, side="right") - 1
    stretches = [(start, np.flatnonzero(scored & (which == k))) for k, start in enumerate(starts)]
    for start, stretch in stretches:
        if not len(stretch):
            raise MclError(f"the reference covers none of the scans from {start:g} s to the next kidnapping or the end")
    return stretches
