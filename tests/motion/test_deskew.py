"""Scans measured on the move, against what the same laser would have seen standing where it was at the stamp."""

from __future__ import annotations

import math

import numpy as np
import pytest
import reference

from pipeline.geometry import compose
from pipeline.logs.messages import Laser
from pipeline.motion.deskew import deskew
from pipeline.simulate.rays import segment_hits

CORNERS = [(0.0, 0.0), (7.0, 0.0), (7.0, 4.0), (5.5, 4.0), (5.5, 5.5), (0.0, 5.5)]
PILLAR = [(2.2, 3.6), (2.6, 3.6), (2.6, 4.0), (2.2, 4.0)]
WALLS = np.array([(*a, *b) for ring in (CORNERS, PILLAR) for a, b in zip(ring, [*ring[1:], ring[0]], strict=True)])
START = np.array([3.1, 2.0, 0.7])


def laser(beams: int = 360, *, time_increment: float = 0.2 / 360, pose=(0.15, -0.05, 0.4), field=2 * math.pi) -> Laser:
    return Laser(pose, -field / 2, field / beams, beams, 0.05, 20.0, time_increment)


def seen(sensor: Laser, poses: np.ndarray) -> np.ndarray:
    """Exact ranges, beam k from the k-th of the robot's poses (beams, 3)."""
    at = compose(poses, sensor.pose)
    angles = at[:, 2] + sensor.angles
    hits = segment_hits(at[:, :2], np.column_stack([np.cos(angles), np.sin(angles)]), WALLS)
    return hits.min(axis=1).astype(np.float32)


def on_the_move(sensor: Laser, velocity) -> tuple[np.ndarray, np.ndarray]:
    """Ranges measured while driving with this velocity from START on, and the sweep."""
    since = np.arange(sensor.beams) * abs(sensor.time_increment)
    moves = np.array([reference.drive(velocity, t) for t in since])
    relative = np.column_stack([moves[:, 0, 2], moves[:, 1, 2], np.asarray(velocity[2]) * since])
    poses = compose(START, relative)
    return seen(sensor, poses if sensor.time_increment > 0 else poses[::-1]), relative[-1]


def away_from_edges(ranges: np.ndarray) -> np.ndarray:
    """Beams whose neighbours, five to each side, are on one surface with them."""
    steps = np.abs(np.diff(ranges, append=ranges[:1])) > 0.3
    return ~np.any([np.roll(steps, shift) for shift in range(-5, 6)], axis=0)


@pytest.mark.parametrize("velocity", [(0.4, 0.0, 1.4), (0.4, 0.0, -1.4), (0.0, 0.0, 1.4), (1.0, 0.2, 0.0)])
@pytest.mark.parametrize("time_increment", [0.2 / 360, -0.2 / 360])
def test_a_room_seen_while_driving_is_that_seen_from_the_stamp(velocity, time_increment: float) -> None:
    sensor = laser(time_increment=time_increment)
    measured, sweep = on_the_move(sensor, velocity)
    exact = seen(sensor, np.tile(START, (sensor.beams, 1)))
    mended = deskew(measured, sensor, sweep)
    clear = away_from_edges(exact) & np.isfinite(mended)
    before, after = np.abs(measured - exact)[clear], np.abs(mended - exact)[clear]
    assert clear.sum() > 250
    assert np.median(after) < 0.001
    assert np.quantile(after, 0.95) < 0.02
    assert np.median(before) > 0.02


def test_a_few_millimetres_of_noise_stay_a_few_millimetres() -> None:
    sensor = laser()
    measured, sweep = on_the_move(sensor, (0.4, 0.0, 1.4))
    noisy = measured + np.random.default_rng(0).normal(0.0, 0.005, sensor.beams).astype(np.float32)
    exact = seen(sensor, np.tile(START, (sensor.beams, 1)))
    clear = away_from_edges(exact)
    assert np.nanmedian(np.abs(deskew(noisy, sensor, sweep) - exact)[clear]) < 0.005


@pytest.mark.parametrize(
    ("time_increment", "sweep"),
    [(0.001, [0.0] * 3), (-0.001, [0.0] * 3), (0.0, [0.3, 0.1, 0.2]), (0.001, [math.nan, 0.0, 0.1])],
)
def test_who_stands_still_sees_what_was_measured_to_the_byte(time_increment: float, sweep: list[float]) -> None:
    sensor = laser(time_increment=time_increment)
    ranges = np.random.default_rng(0).uniform(0.1, 9.0, sensor.beams).astype(np.float32)
    ranges[:20], ranges[50:60] = np.nan, np.inf
    before = ranges.tobytes()
    assert deskew(ranges, sensor, np.array(sweep)).tobytes() == before


def test_the_measured_ranges_are_left_as_they_are() -> None:
    sensor = laser(181, field=math.pi)
    measured, sweep = on_the_move(sensor, (0.4, 0.0, 1.4))
    before = measured.copy()
    mended = deskew(measured, sensor, sweep)
    np.testing.assert_array_equal(measured, before)
    assert (mended.dtype, mended.shape) == (np.float32, (181,))


def test_ranges_that_are_a_row_of_a_read_only_log() -> None:
    sensor = laser()
    measured, sweep = on_the_move(sensor, (0.4, 0.0, 1.4))
    rows = np.stack([measured, measured])
    rows.setflags(write=False)
    np.testing.assert_array_equal(deskew(rows[1], sensor, sweep), deskew(measured, sensor, sweep))


@pytest.mark.parametrize("beams", [1, 2])
def test_hardly_any_beams(beams: int) -> None:
    ranges = np.full(beams, 2.0, np.float32)
    assert deskew(ranges, laser(beams, field=0.1), np.array([0.1, 0.0, 0.02])).shape == (beams,)
