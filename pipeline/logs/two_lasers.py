"""Several lasers of one robot as one: the scan that a laser at the robot's centre would have taken, all round.

A beam of it ends where the nearest point lies that any of the lasers saw in its direction. That is what
ros2_laser_scan_merger and its like publish; it is exact for what is seen, and for what is not as good as the lasers
are near to the centre.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.geometry import between, compose
from pipeline.logs.columns import PoseColumns, ScanColumns
from pipeline.logs.odometry import odometry_at

Array = NDArray[np.float64]

TOGETHER = 0.15
"""s: scans farther apart were not taken together."""
MOST_BEAMS = 1440
"""Beams of the common scan; a quarter of a degree is finer than most lasers see."""
BODY = 0.05
"""m: what is nearer to the centre is no wall."""


def merged(lasers: Sequence[tuple[ScanColumns, Array]], odometry: PoseColumns | None, frame: str) -> ScanColumns:
    """The scans of several lasers as those of one in ``frame``, the robot's centre, at the stamps of the first.

    ``lasers``: scans, with inf where nothing came back and NaN where invalid, and the place of each laser on the robot
    (4, 4). While the robot moved between two scans the odometry says how. Scans of the others that were not taken
    within 0.15 s are left out.
    """
    first, _ = lasers[0]
    finest = min(abs(scans.angle_increment) for scans, _ in lasers)
    beams = min(MOST_BEAMS, max(1, round(2.0 * math.pi / finest)))
    ranges = np.full((len(first), beams), np.nan, np.float32)
    for scans, place in lasers:
        which = _nearest(first.stamps, scans.stamps)
        together = np.abs(scans.stamps[which] - first.stamps) <= TOGETHER * 1e9
        moved = _moved(first, scans.take(which), odometry)
        for row in np.flatnonzero(together):
            _add(ranges[row], scans.ranges[which[row]], scans, place, moved[row])
    return ScanColumns(
        stamps=first.stamps,
        sequences=first.sequences,
        ranges=ranges,
        angle_min=-math.pi,
        angle_increment=2.0 * math.pi / beams,
        range_min=0.0,
        range_max=max(scans.range_max + math.hypot(place[0, 3], place[1, 3]) for scans, place in lasers),
        frame=frame,
        stretch=first.stretch,
        remarks=tuple(remark for scans, _ in lasers for remark in scans.remarks),
    )


def _nearest(stamps: NDArray[np.int64], others: NDArray[np.int64]) -> NDArray[np.intp]:
    """(n,) for each stamp the row of the nearest of the others, which need not be in order."""
    order = np.argsort(others, kind="stable")
    after = np.clip(np.searchsorted(others[order], stamps), 0, len(others) - 1)
    before = np.maximum(after - 1, 0)
    nearer = np.abs(others[order][before] - stamps) <= np.abs(others[order][after] - stamps)
    return order[np.where(nearer, before, after)]


def _moved(first: ScanColumns, other: ScanColumns, odometry: PoseColumns | None) -> Array:
    """(n, 3) where the robot was at the other's scans, seen from where it was at the first's."""
    if odometry is None:
        return np.zeros((len(first), 3))
    at, _ = odometry_at(first.stamps, first.sequences, odometry)
    then, _ = odometry_at(other.stamps, other.sequences, odometry)
    return between(at, then)


def _add(out: NDArray[np.float32], ranges: NDArray[np.float32], scans: ScanColumns, place: Array, moved: Array) -> None:
    """Put the beams (k,) of one scan into the common one ``out`` (beams,), in place."""
    angles = scans.angle_min + scans.angle_increment * np.arange(len(ranges))
    back = np.isfinite(ranges)
    open_ = np.isinf(ranges)
    length = np.where(back, ranges, np.where(open_, scans.range_max, np.nan)).astype(np.float64)
    points = np.stack([length * np.cos(angles), length * np.sin(angles), np.zeros(len(ranges)), np.ones(len(ranges))])
    x, y, _, _ = place @ points
    seen = compose(moved, np.stack([x, y, np.zeros(len(ranges))], axis=1))
    distance = np.hypot(seen[:, 0], seen[:, 1])
    told = np.isfinite(distance) & (distance > BODY)
    beam = np.floor((np.arctan2(seen[told, 1], seen[told, 0]) + math.pi) / (2.0 * math.pi) * len(out) + 0.5)
    beam = beam.astype(np.int64) % len(out)
    value = np.where(back[told], distance[told], np.inf).astype(np.float32)
    # fmin takes the number where the other is none: a wall, then an open way, then nothing known.
    np.fmin.at(out, beam, value)
