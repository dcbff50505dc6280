"""The odometry's noise and the temper, recovered from drives and likelihoods that were made with known ones."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.config import Config
from pipeline.geometry import compose
from pipeline.motion.wheels import odometry_motion
from pipeline.tune.motion import ALPHAS, SMALLEST, fit_motion, windows
from pipeline.tune.scans import updates
from pipeline.tune.temper import MOST, RIVALS, independent_beams

KNOWN = {"alpha1": 0.03, "alpha2": 0.008, "alpha3": 0.04, "alpha4": 0.01}


def drive(n: int, config: Config, seed: int, jitter: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Odometry and true poses (n, 3): stretches straight on, arcs, and turns on the spot; noise as in Table 5.6."""
    rng = np.random.default_rng(seed)
    odometry, poses = np.zeros((n, 3)), np.zeros((n, 3))
    for k in range(1, n):
        kind = k // 25 % 4
        move = [(0.1, 0.0, 0.0), (0.0, 0.0, 0.1), (0.1, 0.0, 0.05), (0.0, 0.0, -0.15)][kind]
        odometry[k] = compose(odometry[k - 1], move)
        m = odometry_motion(odometry[k - 1], odometry[k], config)
        # On the spot the direction of a drive is rounding: one turn, and a slip the way the robot faces.
        turns = (m.rot1, m.rot2) if kind % 2 == 0 else (0.0, m.rot1 + m.rot2)
        rot1, trans, rot2 = rng.normal((turns[0], m.trans, turns[1]), (m.std_rot1, m.std_trans, m.std_rot2))
        poses[k] = compose(compose(poses[k - 1], (0.0, 0.0, rot1)), (trans, 0.0, rot2))
    return odometry, poses + rng.normal(0.0, jitter, poses.shape)


@pytest.mark.parametrize("jitter", [0.0, 0.01])
def test_alphas_are_recovered(jitter: float) -> None:
    config = Config(**KNOWN)
    found = []
    for seed in range(2):
        odometry, poses = drive(4000, config, seed, jitter)
        found.append(windows(odometry, poses, np.arange(4000), config))
    fit = fit_motion(found, Config())
    # A square of a normal number varies by 1.4 times its mean, and longer windows count the shorter ones again.
    for name in ALPHAS:
        assert getattr(fit, name) == pytest.approx(KNOWN[name], rel=0.35), name


def test_a_perfect_odometry_still_leaves_the_filter_some_noise() -> None:
    odometry, _ = drive(2000, Config(), 0)
    fit = fit_motion([windows(odometry, odometry, np.arange(2000), Config())], Config())
    assert all(getattr(fit, name) == SMALLEST for name in ALPHAS)


def test_a_few_jumps_of_hindsight_are_not_the_odometry_s() -> None:
    config = Config(**KNOWN)
    odometry, poses = drive(4000, config, 5)
    for at in (700, 2100, 3300):
        poses[at:] += [15.0, -4.0, 0.0]
    fit = fit_motion([windows(odometry, poses, np.arange(4000), config)], Config())
    assert fit.alpha3 < 3 * KNOWN["alpha3"]
    assert fit.alpha2 < 3 * KNOWN["alpha2"]


def test_too_short_a_drive_leaves_the_odometry_s_noise_as_it_was() -> None:
    odometry, poses = drive(20, Config(), 0)
    assert fit_motion([windows(odometry, poses, np.arange(20), Config())], Config()) == Config()


def test_standing_still_is_no_update() -> None:
    odometry = np.zeros((6, 3))
    odometry[2:, 0], odometry[5:, 2] = 0.1, 0.2
    assert updates(odometry, Config()).tolist() == [0, 2, 5]


@pytest.mark.parametrize("copies", [7, 15, 30])
def test_beams_that_err_together_count_once(copies: int) -> None:
    """Of a right model the logarithm of the odds is normal with a variance of twice its mean; copies only multiply."""
    rng, mean = np.random.default_rng(0), 1.5
    odds = rng.normal(mean, np.sqrt(2 * mean), (6000, 1))
    scores = copies * np.hstack([np.zeros((6000, 1)), -odds])
    assert independent_beams([scores], 60) == pytest.approx(60 / copies, rel=0.12)


def test_no_more_beams_are_believed_than_real_logs_have() -> None:
    rng, mean = np.random.default_rng(0), 1.5
    odds = rng.normal(mean, np.sqrt(2 * mean), (6000, 1))
    assert independent_beams([np.hstack([np.zeros((6000, 1)), -odds])], 60) == pytest.approx(MOST, rel=1e-3)


def test_the_first_rival_is_the_place_itself() -> None:
    assert RIVALS[0].tolist() == [0.0, 0.0, 0.0]
    assert len(np.unique(RIVALS, axis=0)) == len(RIVALS)
