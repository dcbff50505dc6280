"""What a reading is worth where nobody knows what the laser should see: a distribution, learnt from the log."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.world.agnostic import SOME, Agnostic

LONGEST = 16.0
MIDDLES = (np.arange(6400) + 0.5) * LONGEST / 6400


def mass_beyond(known: Agnostic, far: float) -> float:
    """Of all readings longer than ``far``, by adding up densities, and of those that do not come back."""
    step = LONGEST / len(MIDDLES)
    density = known.density(MIDDLES.astype(np.float32))
    return float(density[far < MIDDLES].sum() * step + known.density(np.array([np.inf], np.float32))[0])


def taught() -> Agnostic:
    known = Agnostic(LONGEST)
    rng = np.random.default_rng(0)
    for _ in range(30):
        ranges = rng.gamma(3.0, 1.0, 180).astype(np.float32)
        ranges[rng.random(180) < 0.07] = np.inf
        known.learn(ranges)
    return known


@pytest.mark.parametrize("known", [Agnostic(LONGEST), taught()], ids=["new", "taught"])
def test_density_integrates_to_one_and_survival_is_what_is_left_of_it(known: Agnostic) -> None:
    assert mass_beyond(known, 0.0) == pytest.approx(1.0, abs=1e-6)
    far = np.array([0.0, 0.3, 2.0, 3.71, 8.0, 15.9, LONGEST])
    beyond = [mass_beyond(known, float(f)) for f in far]
    np.testing.assert_allclose(known.survival(far), beyond, atol=5e-4)
    assert known.survival(np.array([0.0]))[0] == 1.0
    never_back = known.density(np.array([np.inf], np.float32))
    np.testing.assert_allclose(known.survival(np.array([90.0])), never_back)


def test_it_learns_what_this_laser_reads_here() -> None:
    known = taught()
    asked = np.array([2.0, 12.0, np.inf], np.float32)
    often, seldom, never_back = known.density(asked)
    assert often > 10.0 * seldom
    assert never_back == pytest.approx(0.07, abs=0.01)
    even = Agnostic(LONGEST).density(asked)
    assert even[0] == even[1] == pytest.approx(0.98 / LONGEST)


def test_what_is_invalid_says_nothing_and_teaches_nothing() -> None:
    known, before = taught(), taught()
    known.learn(np.full(180, np.nan, np.float32))
    asked = np.array([1.0, np.nan, np.inf, 7.0], np.float32)
    np.testing.assert_array_equal(known.density(asked), before.density(asked))
    assert known.density(asked)[1] == 1.0


def test_one_scan_outweighs_nothing_yet() -> None:
    """What is known before counts as many beams: a first scan that sees one wall only makes nothing else impossible."""
    known = Agnostic(LONGEST)
    known.learn(np.full(100, 3.0, np.float32))
    far = known.density(np.array([9.0], np.float32))[0]
    assert far == pytest.approx(0.98 / LONGEST * SOME / (SOME + 100), rel=1e-6)


def test_readings_beyond_the_longest_range_count_as_the_longest() -> None:
    known = Agnostic(LONGEST)
    known.learn(np.full(500, 17.5, np.float32))
    last, before = known.density(np.array([15.9, 15.0], np.float32))
    assert last > 50.0 * before
    assert mass_beyond(known, 0.0) == pytest.approx(1.0, abs=1e-6)
