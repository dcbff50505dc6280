"""The rewrite of AMCL's filter with which its parameters are measured follows a robot, and moves as the book says."""

from __future__ import annotations

import math

import amcl
import numpy as np
import pytest

from pipeline.evaluate.metrics import interpolate, is_localized, pose_errors
from pipeline.geometry import wrap_angle
from pipeline.logs.messages import Log
from pipeline.nav2 import DEFAULTS

TUNED = {f"alpha{k}": 0.02 for k in range(1, 5)} | {"sigma_hit": 0.1, "z_hit": 0.9, "z_rand": 0.1}


def right(log: Log, poses: np.ndarray) -> float:
    assert log.ground_truth is not None
    return float(is_localized(*pose_errors(poses, interpolate(log.ground_truth, log.stamps))).mean())


def start(log: Log) -> np.ndarray:
    assert log.ground_truth is not None
    return interpolate(log.ground_truth, log.stamps)[0]


@pytest.mark.parametrize("model", ["likelihood_field", "likelihood_field_prob"])
def test_it_follows_the_robot_from_a_known_start(office: Log, model: str) -> None:
    given = {**DEFAULTS, **TUNED, "laser_model_type": model}
    poses = amcl.run(office, given, start(office), 0)
    assert right(office, poses) > 0.9
    np.testing.assert_array_equal(poses, amcl.run(office, given, start(office), 0))
    elsewhere = start(office) + np.array([5.0, 0.0, 1.0])
    assert right(office, amcl.run(office, given, elsewhere, 0)) < 0.5


def test_particles_move_as_table_5_6_has_it() -> None:
    """Mean and deviations of a step of 1 m after a turn of 0.5 rad."""
    particles = np.zeros((200_000, 3))
    delta, alphas = np.array([math.cos(0.5), math.sin(0.5), 0.8]), np.array([0.02, 0.01, 0.04, 0.03])
    amcl._move(particles, delta, 0.0, alphas, np.random.default_rng(0))
    far = np.hypot(particles[:, 0], particles[:, 1])
    assert far.mean() == pytest.approx(1.0, abs=0.01)
    assert far.std() == pytest.approx(math.sqrt(0.04 + 0.03 * (0.5**2 + 0.3**2)), rel=0.03)
    turned = np.asarray(wrap_angle(particles[:, 2]))
    assert turned.mean() == pytest.approx(0.8, abs=0.01)
    assert turned.std() == pytest.approx(math.sqrt(0.02 * (0.5**2 + 0.3**2) + 2 * 0.01), rel=0.03)


def test_the_number_of_particles_is_foxs() -> None:
    from pipeline.filter.adaptive import kld_bound

    for bins in (2, 10, 300):
        assert amcl._limit(bins, 1, 10**9, 0.05, 2.33) == pytest.approx(kld_bound(bins, 0.05, 2.33), abs=1)
    assert amcl._limit(1, 5, 70, 0.05, 2.33) == 70


def test_the_heaviest_heap_is_the_estimate() -> None:
    rng = np.random.default_rng(1)
    heaps = [rng.normal((2.0, 3.0, 1.0), 0.1, (300, 3)), rng.normal((9.0, 3.0, 1.0), 0.1, (200, 3))]
    np.testing.assert_allclose(amcl._best_cluster(np.concatenate(heaps)), (2.0, 3.0, 1.0), atol=0.05)
