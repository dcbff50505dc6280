"""Numbers that no robot produces are left out where messages enter: counted, and the first of them named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.logs.columns import PoseColumns, ScanColumns

FARTHEST = 1e7
"""m: a quarter of the way round the Earth. Who is farther from an origin was never there."""
_NAMES = ("x", "y", "z", "qx", "qy", "qz", "qw")
_NORM, _NEARLY = (0.1, 10.0), 1e-3
"""Lengths of a quaternion that somebody may have meant, and how far from 1 it may be to be taken as it is."""

_LONGEST = 1000.0  # m: no laser's shortest range is as long as that
_TURNS = 10
"""So often the beams of a scan may go round: more is no field of view."""


def sound_poses(poses: PoseColumns, what: str) -> PoseColumns:
    """The poses that a robot can have; ``what`` names the topic, or the transform, in remarks.

    Left out are numbers that are not finite or farther than ``FARTHEST``, and quaternions of no sensible length; other
    lengths become 1. Quaternions of zeros mean no turn if all are so: nobody filled them in. Raises MclError if nothing
    is left.
    """
    values = np.column_stack([poses.positions, poses.orientations])
    with np.errstate(invalid="ignore", over="ignore"):
        lengths = np.linalg.norm(poses.orientations, axis=1)
        wrong = ~np.isfinite(values)
        wrong[:, :3] |= np.abs(poses.positions) > FARTHEST
        wrong[:, 3:] |= np.abs(poses.orientations) > _NORM[1]
        unlikely = ~((lengths >= _NORM[0]) & (lengths <= _NORM[1]))
    never_filled = bool((lengths[~wrong.any(axis=1)] == 0.0).all())
    if not never_filled:
        wrong[unlikely & ~wrong.any(axis=1), 3:] = True
    bad: NDArray[np.bool_] = np.any(wrong, axis=1)
    if bad.all():
        raise MclError(f"{what}: none of {_messages(len(bad))} says a pose that can be one: {_first(values, wrong)}")
    remarks = poses.remarks
    if bad.any():
        remarks = (*remarks, _left_out(what, values, wrong))
        poses, lengths = poses.take(~bad), lengths[~bad]
    if never_filled and len(poses):
        remarks = (*remarks, f"{what}: its quaternions are all zeros, which nobody filled in: taken for no turn")
    off = (np.abs(lengths - 1.0) > _NEARLY) & (lengths > 0.0)
    if off.any():
        turns = np.where(off[:, None], poses.orientations / np.where(off, lengths, 1.0)[:, None], poses.orientations)
        poses = replace(poses, orientations=turns)
    return replace(poses, remarks=remarks)


def unlikely_constants(constants: Sequence[float], beams: int) -> str:
    """What is wrong with angle_min, angle_increment, range_min and range_max of a scan; empty if nothing is.

    An increment of zero and a range that was never filled in are left to those who know better what to do.
    """
    angle_min, increment, _, _ = constants
    for name, value in (("angle_min", angle_min), ("angle_increment", increment)):
        if not np.isfinite(value):
            return f"{name} is {value}"
    if abs(angle_min) > 4 * np.pi:
        return f"angle_min is {angle_min:g}, farther round than any laser turns"
    if abs(increment) * (beams - 1) > _TURNS * 2 * np.pi:
        return f"angle_increment is {increment:g}, and {beams} beams that far apart go round more than {_TURNS} times"
    return ""


def sound_limits(scans: ScanColumns, what: str) -> ScanColumns:
    """The scans with a shortest range that can be one, else 0; ``collect.mark_no_return`` looks at the longest."""
    low, high = scans.range_min, scans.range_max
    if abs(low) < _LONGEST and (low < high or not high > 0.0):
        return scans
    said = f"{what}: its range_min is {low:g} and its range_max {high:g}: range_min is taken for 0"
    return replace(scans, range_min=0.0, remarks=(*scans.remarks, said))


def _left_out(what: str, values: NDArray[np.float64], wrong: NDArray[np.bool_]) -> str:
    count = int(wrong.any(axis=1).sum())
    return f"{what}: {count:,} of {_messages(len(wrong))} left out, no robot says that: {_first(values, wrong)}"


def _first(values: NDArray[np.float64], wrong: NDArray[np.bool_]) -> str:
    """The first three of the messages, and what is wrong with each."""
    rows = np.flatnonzero(wrong.any(axis=1)).tolist()
    named = [f"message {row + 1:,} has {_number(values[row], wrong[row])}" for row in rows[:3]]
    return ", ".join(named) + (f", and {len(rows) - 3:,} more" if len(rows) > 3 else "")


def _number(values: NDArray[np.float64], wrong: NDArray[np.bool_]) -> str:
    column = int(np.flatnonzero(wrong)[0])
    if column >= 3 and np.abs(values[3:]).max() <= _NORM[1]:
        return "a quaternion of length " + f"{np.linalg.norm(values[3:]):g}"
    return f"{_NAMES[column]} = {values[column]:g}"


def _messages(count: int) -> str:
    return f"{count:,} messages" if count != 1 else "1 message"
