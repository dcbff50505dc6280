"""Laser odometry: where a robot went, told by its laser and its wheels without any map, and how far each drifts."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.evaluate.drift import (
    Drift,
    MetreDrift,
    RelationErrors,
    Relations,
    Spread,
    drift,
    driven,
    relation_errors,
)
from pipeline.evaluate.metrics import Array, interpolate, known, laser_to_base
from pipeline.geometry import compose
from pipeline.logs.messages import Log, Scan, Trajectory

BOTH, LASER, WHEELS = "laser and wheels", "laser alone", "wheels"

DRIFT_COLUMNS = (
    "odometry",
    "200 scans (m)",
    "(deg)",
    "1 m (%)",
    "(deg/m)",
    "5 m (%)",
    "(deg/m)",
    "10 m (%)",
    "(deg/m)",
    "ms a scan",
)
"""Headings of ``drift_table``: medians over windows; per metre over stretches of the length that heads the column."""
RELATION_COLUMNS = ("odometry", "error (m)", "(deg)", "squared (m^2)", "(deg^2)", "relations")
"""Headings of ``relation_table``: means, and the standard deviations of what they are means of."""

Row = tuple[str, ...]


class Progress(Protocol):
    """Passes the scans on and shows how many of ``total`` have passed: ``console.progress``."""

    def __call__(self, items: Iterable[Scan], total: int, label: str) -> Iterator[Scan]:
        """Iterate lazily over the scans."""
        ...


@dataclass(frozen=True)
class DeadReckoning:
    """Where the robot was at every scan by dead reckoning, nothing having looked ahead.

    ``poses`` (n, 3) m and rad of base_link, in a frame of their own that starts where the odometry does; ``stamps``
    (n,) int64 ns; ``seconds`` (n,) of wall clock that each scan took, zeros for the wheels. ``by``: who says so;
    ``faults`` of the wheels that the laser has shown on the way, a sentence each.
    """

    by: str
    stamps: NDArray[np.int64]
    poses: Array
    seconds: Array
    faults: tuple[str, ...] = ()

    @property
    def trajectory(self) -> Trajectory:
        """The poses over time."""
        return Trajectory(self.stamps, self.poses, "odom")

    @property
    def driven(self) -> float:
        """Metres driven by these poses."""
        return float(driven(self.poses)[-1])

    @property
    def milliseconds(self) -> float:
        """Wall clock that a scan takes, the median, ms."""
        return 1e3 * float(np.median(self.seconds))


@dataclass(frozen=True)
class Judged:
    """A dead reckoning with its errors: ``drift`` against a reference, ``relations`` in those given; None without."""

    reckoning: DeadReckoning
    drift: Drift | None
    relations: RelationErrors | None

    def to_dict(self) -> dict[str, Any]:
        """As plain values, ready for JSON: metres, degrees, %, degrees per metre, milliseconds."""
        seconds = self.reckoning.seconds
        timed = self.reckoning.by != WHEELS
        p95 = 1e3 * float(np.percentile(seconds, 95))
        return {
            "odometry": self.reckoning.by,
            "driven": self.reckoning.driven,
            "milliseconds": {"median": self.reckoning.milliseconds, "p95": p95} if timed else None,
            "drift": None if self.drift is None else self.drift.to_dict(),
            "relations": None if self.relations is None else self.relations.to_dict(),
        }


def laser_odometry(log: Log, config: Config, *, alone: bool = False, progress: Progress | None = None) -> DeadReckoning:
    """Where the robot went, by its laser and its wheels, or by its laser ``alone``. Needs no map.

    ``config``: which witnesses are heard is decided by ``alone``, whatever its ``odometry`` says. A log without wheels
    has its laser alone in any case.
    """
    from pipeline.motion.witnesses import Witnesses

    alone = alone or not log.wheels
    heard = config.model_copy(update={"odometry": "laser" if alone else "both"})
    witnesses = Witnesses(log.laser, heard, wheels=not alone)
    poses, seconds, faults = np.zeros((len(log), 3)), np.zeros(len(log)), list[str]()
    scans = log.scans() if progress is None else progress(log.scans(), len(log), "laser odometry")
    for i, scan in enumerate(scans):
        start = time.perf_counter()
        motion = witnesses.update(scan)
        seconds[i] = time.perf_counter() - start
        poses[i] = motion.pose
        faults += [fault.text for fault in motion.faults]
    return DeadReckoning(LASER if alone else BOTH, log.stamps, poses, seconds, tuple(faults))


def wheel_odometry(log: Log) -> DeadReckoning:
    """Where the robot went by its wheels: the log's own odometry, without leaps. Raises MclError if it has none."""
    from pipeline.motion.faults import without_leaps

    if not log.wheels:
        raise MclError("this log has no odometry", path=log.path)
    return DeadReckoning(WHEELS, log.stamps, without_leaps(log.times, log.odometry), np.zeros(len(log)))


def judge(
    log: Log,
    reckonings: Sequence[DeadReckoning],
    reference: Trajectory | None = None,
    relations: Relations | None = None,
    *,
    reference_frame: Literal["base_link", "laser"] = "base_link",
) -> list[Judged]:
    """How far each of the ``reckonings`` of a log drifts against a reference, and how wrong it is in ``relations``.

    ``reference``: poses of ``reference_frame`` in any frame; without one, the log's own truth if it knows it.
    ``relations``: of the laser, as the Freiburg SLAM benchmark has them. Raises MclError for a reference that does not
    overlap the log in time, and for relations of another log.
    """
    truth = _truth(log, reference, reference_frame)
    judged = []
    for each in reckonings:
        errors = None
        if relations is not None:
            errors = relation_errors(log.stamps, compose(each.poses, log.laser.pose), relations)
        judged.append(Judged(each, None if truth is None else drift(each.poses, truth), errors))
    return judged


def _truth(log: Log, reference: Trajectory | None, frame: str) -> Array | None:
    if reference is not None and frame == "laser":
        reference = laser_to_base(reference, log.laser.pose)
    reference = log.ground_truth if reference is None else reference
    if reference is None:
        return None
    truth = interpolate(reference, log.stamps)
    if not known(truth).any():
        raise MclError("the reference does not overlap the log in time", "of another log?", path=log.path)
    return truth


# --- tables ---------------------------------------------------------------------------------------------------------


def drift_table(judged: Sequence[Judged]) -> list[Row]:
    """One row of strings for each that was judged against a reference, under DRIFT_COLUMNS."""
    return [_drift_row(each.reckoning, each.drift) for each in judged if each.drift is not None]


def relation_table(judged: Sequence[Judged]) -> list[Row]:
    """One row of strings for each that was judged by relations, under RELATION_COLUMNS."""
    rows: list[Row] = []
    for each in judged:
        errors = each.relations
        if errors is None:
            continue
        rows.append(
            (
                each.reckoning.by,
                _spread(errors.translation, 3),
                _spread(errors.rotation, 2),
                _spread(errors.squared_translation, 3),
                _spread(errors.squared_rotation, 2),
                f"{errors.used:,} of {errors.total:,}",
            )
        )
    return rows


def _drift_row(reckoning: DeadReckoning, found: Drift) -> Row:
    scans = found.over_scans
    return (
        reckoning.by,
        *(("-", "-") if scans is None else (f"{scans.position:.2f}", f"{scans.heading:.2f}")),
        *(text for each in found.per_metre for text in _per_metre(each)),
        "-" if reckoning.by == WHEELS else f"{reckoning.milliseconds:.2f}",
    )


def _per_metre(found: MetreDrift | None) -> Row:
    return ("-", "-") if found is None else (f"{found.position:.2f}", f"{found.heading:.3f}")


def _spread(errors: Spread, digits: int) -> str:
    return f"{errors.mean:.{digits}f} ± {errors.std:.{digits}f}"


def reckonings_beside(
    log: Log, config: Config, first: DeadReckoning, progress: Progress | None = None
) -> list[DeadReckoning]:
    """``first`` and what it is to be compared with: the laser with and without the wheels, and the wheels."""
    if not log.wheels:
        return [first]
    other = laser_odometry(log, config, alone=first.by != LASER, progress=progress)
    return [*sorted([first, other], key=lambda each: each.by == LASER), wheel_odometry(log)]


def write_mcap(path: Path, log: Log, reckoning: DeadReckoning) -> None:
    """Writes the log's messages into ``path`` and with them the poses, as nav_msgs/Odometry on /laser_odom.

    Raises MclError if the log is not an .mcap or the file cannot be written.
    """
    from pipeline.logs.laser_odometry import write_with_laser_odometry

    write_with_laser_odometry(path, log, reckoning.poses, {"by": reckoning.by})
