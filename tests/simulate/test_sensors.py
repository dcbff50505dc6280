"""Simulated sensors: their noise is what the description says, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.geometry import compose, wrap_angle
from pipeline.simulate.building import Building, Laser, Odometry
from pipeline.simulate.sensors import decompose, measure_odometry, measure_ranges, true_ranges
from pipeline.simulate.world import World, build_world

NOBODY = np.empty((0, 3))
EXACT = {"alpha1": 0.0, "alpha2": 0.0, "alpha3": 0.0, "alpha4": 0.0}
SILENT = {"sigma": 0.0, "random": 0.0, "missing": 0.0}


def wander(steps: int, seed: int = 3) -> np.ndarray:
    """A true motion forwards, backwards and on the spot; yaw unwrapped."""
    rng = np.random.default_rng(seed)
    motion = np.column_stack([rng.uniform(-0.1, 0.2, steps), np.zeros(steps), rng.uniform(-0.3, 0.3, steps)])
    motion[::5] = 0.0
    motion[1::7, 0] = 0.0
    poses = np.zeros((steps + 1, 3))
    for i in range(steps):
        poses[i + 1] = compose(poses[i], motion[i])
    poses[:, 2] = np.unwrap(poses[:, 2])
    return poses


def hall(**parts) -> World:
    description = {
        "name": "hall",
        "map": {"size": [10, 10]},
        "rooms": [{"name": "hall", "box": [1, 1, 9, 9]}],
        "robot": {"start": [5, 5], "legs": [{"pause": 1}]},
    }
    return build_world(Building.model_validate(description | parts), mapped=False)


@pytest.mark.parametrize(
    ("motion", "expected"),
    [
        ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        ((-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
        ((0.0, 0.0, 0.7), (0.0, 0.0, 0.7)),
        ((1.0, 1.0, 0.0), (np.pi / 4, np.sqrt(2), -np.pi / 4)),
        ((-1.0, -1.0, 0.2), (np.pi / 4, -np.sqrt(2), 0.2 - np.pi / 4)),
    ],
)
def test_a_motion_is_a_turn_a_drive_and_a_turn(motion, expected) -> None:
    assert np.array(decompose(np.array(motion))) == pytest.approx(np.array(expected))


def test_exact_odometry_is_the_truth_seen_from_its_own_start() -> None:
    truth = wander(200)
    start = (3.0, -2.0, 1.1)
    odometry = measure_odometry(truth, Odometry(start=start, **EXACT), np.random.default_rng(0))
    expected = compose(start, truth)
    assert odometry[:, :2] == pytest.approx(expected[:, :2], abs=1e-9)
    assert wrap_angle(odometry[:, 2] - expected[:, 2]) == pytest.approx(np.zeros(201), abs=1e-9)


def test_odometry_errors_have_the_deviations_of_table_5_6() -> None:
    step = np.array([0.4 * np.cos(0.3), 0.4 * np.sin(0.3), 0.5])  # turn 0.3, drive 0.4, turn 0.2
    a1, a2, a3, a4 = 0.03, 0.04, 0.02, 0.05
    noise = Odometry(alpha1=a1, alpha2=a2, alpha3=a3, alpha4=a4)
    truth = np.stack([np.zeros(3), step])
    rng = np.random.default_rng(7)
    ends = np.array([measure_odometry(truth, noise, rng)[1] for _ in range(20_000)])
    distance = np.hypot(ends[:, 0], ends[:, 1])
    turn1 = np.arctan2(ends[:, 1], ends[:, 0])
    turn2 = ends[:, 2] - turn1
    for measured, mean, variance in (
        (turn1, 0.3, a1 * 0.3**2 + a2 * 0.4**2),
        (distance, 0.4, a3 * 0.4**2 + a4 * (0.3**2 + 0.2**2)),
        (turn2, 0.2, a1 * 0.2**2 + a2 * 0.4**2),
    ):
        deviation = np.sqrt(variance)
        assert measured.mean() == pytest.approx(mean, abs=5 * deviation / np.sqrt(20_000))
        assert measured.std() == pytest.approx(deviation, rel=0.03)
    correlation = np.corrcoef([turn1, distance, turn2]) - np.eye(3)
    assert np.abs(correlation).max() < 0.03


def test_over_many_steps_the_yaw_error_grows_as_derived() -> None:
    """Straight ahead in n equal steps of d: each adds two turns of variance alpha2 d^2."""
    n, d, alpha2 = 100, 0.05, 0.02
    truth = np.column_stack([d * np.arange(n + 1), np.zeros(n + 1), np.zeros(n + 1)])
    noise = Odometry(**(EXACT | {"alpha2": alpha2}))
    rng = np.random.default_rng(11)
    errors = [measure_odometry(truth, noise, rng)[-1, 2] for _ in range(3000)]
    assert np.std(errors) == pytest.approx(np.sqrt(2 * n * alpha2) * d, rel=0.05)


def test_standing_still_adds_no_error() -> None:
    truth = np.tile([2.0, 3.0, 0.5], (50, 1))
    odometry = measure_odometry(truth, Odometry(scale=1.1, drift_deg=5), np.random.default_rng(0))
    assert np.ptp(odometry, axis=0).tolist() == [0.0, 0.0, 0.0]


def test_systematic_errors_scale_and_turn() -> None:
    truth = np.column_stack([0.1 * np.arange(101), np.zeros(101), np.zeros(101)])
    noise = Odometry(scale=1.03, drift_deg=2.0, **EXACT)
    odometry = measure_odometry(truth, noise, np.random.default_rng(0))
    assert odometry[-1, 2] == pytest.approx(np.deg2rad(20.0))
    assert np.hypot(*np.diff(odometry[:, :2], axis=0).T).sum() == pytest.approx(10.3)


def test_a_silent_laser_measures_exactly_from_its_place_ahead_of_the_centre() -> None:
    ranges = measure_ranges(hall(), NOBODY, np.array([5.0, 5.0, 0.0]), Laser(**SILENT), np.random.default_rng(0))
    assert ranges.shape == (180,)
    assert ranges[0] == pytest.approx(3.94)  # to the right
    assert ranges[90] == pytest.approx(3.69)  # ahead
    assert ranges[45] == pytest.approx(3.69 * np.sqrt(2))


def test_laser_noise_has_the_shares_and_the_deviation_it_is_given() -> None:
    world, pose = hall(), np.array([5.0, 5.0, 0.4])
    noise = Laser(sigma=0.03, random=0.05, missing=0.02, max_range=40.0)
    rng = np.random.default_rng(5)
    scans = np.array([measure_ranges(world, NOBODY, pose, noise, rng) for _ in range(500)])
    origin = pose[:2] + 0.25 * np.array([np.cos(0.4), np.sin(0.4)])
    errors = scans - true_ranges(world, NOBODY, origin, 0.4 + noise.bearings, np.empty((180, 0)))
    good = np.abs(errors) < 0.2
    assert np.isinf(scans).mean() == pytest.approx(0.02, abs=0.003)
    # A reading that means nothing may fall on the wall by chance: a range of 0.4 m in 40 m.
    assert good.mean() == pytest.approx(1 - 0.02 - 0.05 * (1 - 0.01), abs=0.005)
    assert errors[good].std() == pytest.approx(0.03, rel=0.03)
    assert errors[good].mean() == pytest.approx(0.0, abs=0.002)
    assert scans.min() > 0.0


def test_glass_returns_as_often_as_it_is_seen() -> None:
    world = hall(glass=[{"start": [9, 4], "end": [9, 6], "seen": 0.3}])
    rng = np.random.default_rng(2)
    ahead = np.array(
        [measure_ranges(world, NOBODY, np.array([5.0, 5.0, 0.0]), Laser(**SILENT), rng)[90] for _ in range(2000)]
    )
    assert set(np.unique(np.round(ahead, 6))) == {3.75, np.inf}
    assert np.isfinite(ahead).mean() == pytest.approx(0.3, abs=0.05)


def test_nothing_returns_from_beyond_the_maximum_range() -> None:
    noise = Laser(**SILENT, max_range=3.8)
    ranges = measure_ranges(hall(), NOBODY, np.array([5.0, 5.0, 0.0]), noise, np.random.default_rng(0))
    assert np.isinf(ranges[0])
    assert ranges[90] == pytest.approx(3.69)
