"""When scans begin to speak for the world, and when what they said is taken back."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipeline.geometry import compose
from pipeline.logs.messages import Laser
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.maps.range_table import range_codes
from pipeline.world.memory import KEY_D, PAUSE, PROVED, RECENT, KeyScan, Memory
from pipeline.world.seen import WALL
from pipeline.world.world import World

BEAMS = 61
LASER = Laser((0.2, 0.0, math.pi / 2), -math.pi / 6, math.pi / 180, beams=BEAMS, range_min=0.0, range_max=8.0)
DISTANCE, SPEED = 2.0, 0.5
"""m and m/s: a wall on the robot's left, along which it drives."""
WALL_SEEN = (DISTANCE / np.cos(LASER.angles)).astype(np.float32)
START, ELSEWHERE = np.array([1.05, 3.05, 0.0]), np.array([9.05, 6.05, math.pi / 2])
"""Poses of the grid frame, from which the robot drives straight on."""
ODOMETRY = np.array([4.0, -7.0, 2.0])
"""Where the laser's odometry begins: in a frame of its own."""


class Told:
    """A memory and the drive that it hears of, a scan every half second, along a wall."""

    def __init__(self) -> None:
        grid = OccupancyGrid(np.zeros((140, 160), np.float32), 0.1)
        self.world = World(grid, 0.65, range_codes(grid, 8.0), 424)
        self.memory = Memory(self.world, LASER)
        self.time = 0.0
        self.spoken: list[int] = []

    def drive(self, seconds: float, *, believed: np.ndarray = START, settled: bool = True, stretch: int = 0) -> None:
        """``believed``: where the robot is thought to have started."""
        for _ in range(round(2 * seconds)):
            step = np.array([SPEED * self.time, 0.0, 0.0])
            at = compose(believed, step)
            scan = KeyScan(self.time, stretch, compose(ODOMETRY, step), WALL_SEEN, at)
            self.memory.follow(scan, settled)
            self.spoken.append(self.memory.scans)
            self.time += 0.5

    def hits_near(self, place: np.ndarray, radius: float = 0.3) -> float:
        rows, cols = np.nonzero(self.world.seen.hits)
        at = (np.stack([cols, rows], axis=1) - self.world.margin + 0.5) * 0.1
        near = np.hypot(*(at - place[:2]).T) < radius
        return float(self.world.seen.hits[rows[near], cols[near]].sum())


def wall_beside(start: np.ndarray, way: float = 0.0) -> np.ndarray:
    """The place straight before the laser, when the robot has driven so far."""
    return compose(start, (way + LASER.pose[0], DISTANCE, 0.0))


def test_nothing_speaks_before_its_place_has_proved_right_and_the_robot_has_gone_on() -> None:
    told = Told()
    told.drive(25.0)
    times = 0.5 * np.arange(50)
    spoken = np.array(told.spoken)
    assert not spoken[times <= PROVED].any()
    assert spoken[times > PROVED].all()
    # Those that are older than RECENT, and each scan is a key scan here.
    expected = np.floor((times - RECENT) / 0.5) + 1
    np.testing.assert_array_equal(spoken[times > PROVED], expected[times > PROVED])


def test_a_contested_place_has_to_prove_right_anew() -> None:
    told = Told()
    told.drive(8.0)
    told.drive(0.5, settled=False)
    told.drive(10.0)
    assert told.spoken[-1] == 0
    told.drive(0.5)
    assert told.spoken[-1] > 0


def test_scans_say_where_the_wall_was_seen_from_where_they_are_believed_to_have_been_taken() -> None:
    told = Told()
    told.drive(12.0)
    assert told.hits_near(wall_beside(START)) >= 1.0
    assert told.hits_near(wall_beside(START, SPEED * 11.0)) == 0.0  # too recent
    laser = compose(START, LASER.pose)
    row, col = np.floor(laser[[1, 0]] / 0.1).astype(int) + told.world.margin
    assert told.world.seen.passes[row + 3, col] >= 1.0


def test_the_world_is_renewed_at_once_and_then_at_intervals() -> None:
    """What speaks is let in every few seconds: whatever was computed from the world has to be computed again."""
    told, versions = Told(), []
    for _ in range(60):
        told.drive(0.5)
        versions.append(told.world.version)
    changes = 0.5 * (np.flatnonzero(np.diff(versions)) + 1)
    assert len(changes) >= 3
    assert (np.diff(changes) > PAUSE).all()
    assert (told.world.kinds == WALL).any()


def test_a_robot_that_stands_still_says_the_same_but_once_in_a_while() -> None:
    told = Told()
    for _ in range(60):
        scan = KeyScan(told.time, 0, ODOMETRY, WALL_SEEN, START)
        told.memory.follow(scan, True)
        told.time += 0.5
    assert 1 <= told.memory.scans <= told.time / RECENT


@pytest.mark.parametrize(("way", "turned"), [(0.9 * KEY_D, 0.0), (0.0, math.radians(9.0))])
def test_a_little_way_is_none(way: float, turned: float) -> None:
    told = Told()
    for k in range(60):
        step = (way, 0.0, turned) if k % 2 else (0.0, 0.0, 0.0)
        at = compose(START, step)
        scan = KeyScan(told.time, 0, compose(ODOMETRY, step), WALL_SEEN, at)
        told.memory.follow(scan, True)
        told.time += 0.5
    assert 1 <= told.memory.scans <= told.time / RECENT


def test_at_the_end_what_has_proved_right_speaks_at_once() -> None:
    told = Told()
    told.drive(11.0)
    kept = told.memory.scans
    told.memory.close()
    assert told.memory.scans == 22 > kept
    assert (told.world.kinds == WALL).any()
    told.memory.close()
    assert told.memory.scans == 22


def test_at_the_end_what_has_not_never_will() -> None:
    told = Told()
    told.drive(9.0)
    told.memory.close()
    assert told.memory.scans == 0
    told.drive(11.0, stretch=0)  # after a gap: a stretch of its own, though the laser's odometry counts on
    told.memory.close()
    assert told.memory.scans == 22


def test_a_belief_that_moves_after_a_gap_leaves_what_was_before_it() -> None:
    told = Told()
    told.drive(20.0)
    told.memory.close()
    kept = told.memory.scans
    told.memory.moved()  # at the first scan after the gap, before that is heard of
    assert told.memory.scans == kept > 10


def test_a_belief_that_moves_takes_what_it_wrote_along() -> None:
    told = Told()
    told.drive(20.0)
    written = told.memory.scans
    assert written > 10
    assert told.hits_near(wall_beside(START)) > 0.0
    told.memory.moved()
    assert told.memory.scans == 0
    assert not told.world.seen.hits.any()
    np.testing.assert_array_equal(told.world.kinds, told.world.mapped)  # at once
    told.drive(10.5, believed=ELSEWHERE)
    assert told.memory.scans == 0
    told.drive(2.0, believed=ELSEWHERE)
    assert told.memory.scans > written
    assert told.hits_near(wall_beside(START)) == 0.0
    # Also the very first scan of the drive, of which nobody then knew that it was taken there.
    assert told.hits_near(wall_beside(ELSEWHERE)) > 0.0


def test_what_was_written_before_a_gap_stays_when_the_belief_moves() -> None:
    told = Told()
    told.drive(11.0)
    told.memory.close()
    before = told.memory.scans
    hits = told.hits_near(wall_beside(START))
    told.drive(15.0)
    assert told.memory.scans > before
    told.memory.moved()
    assert told.memory.scans == before
    assert told.hits_near(wall_beside(START)) == pytest.approx(hits)


def test_what_earlier_runs_saw_stays_when_the_belief_moves() -> None:
    first = Told()
    first.drive(15.0)
    first.memory.close()
    told = Told()
    told.memory = Memory(told.world, LASER, first.world.seen)
    assert (told.world.kinds == WALL).any()
    hits = told.world.seen.hits.copy()
    told.drive(15.0, believed=ELSEWHERE)
    assert (told.world.seen.hits > hits).any()
    told.memory.moved()
    np.testing.assert_array_equal(told.world.seen.hits, hits)


def test_a_scan_that_was_believed_elsewhere_is_put_where_the_way_to_it_leads() -> None:
    """Within a metre it stays: the odometry has drifted, and the belief knew better then."""
    for off, kept in ((0.5, True), (3.0, False)):
        told = Told()
        aside = compose(START, (0.0, off, 0.0))
        told.drive(3.0, believed=aside)
        told.drive(13.0)
        assert (told.hits_near(wall_beside(aside), 0.2) > 0.0) is kept
        assert (told.hits_near(wall_beside(START), 0.2) > 0.0) is not kept


def test_stretches_of_the_odometry_have_nothing_to_do_with_each_other() -> None:
    """After a break a scan is where it was believed to be, whatever the new frame makes of its way."""
    told = Told()
    told.drive(3.0)
    for _ in range(26):
        way = compose((50.0, 50.0, -1.0), (SPEED * told.time, 0.0, 0.0))
        at = compose(START, (SPEED * told.time, 0.0, 0.0))
        told.memory.follow(KeyScan(told.time, 1, way, WALL_SEEN, at), True)
        told.time += 0.5
    assert told.memory.scans >= 6
    assert told.hits_near(wall_beside(START)) > 0.0
    told.memory.moved()
    assert told.hits_near(wall_beside(START)) > 0.0  # of the stretch before, nothing is taken back
