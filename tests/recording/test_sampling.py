"""The particles that are recorded are drawn fairly, and the histograms count every particle."""

import numpy as np
import pytest

from pipeline.recording import palette
from pipeline.recording.sampling import draw, weight_bars


def test_all_are_taken_where_they_fit():
    assert draw(7, 7, seed=0, scan=3).tolist() == list(range(7))
    assert draw(3, 7, seed=0, scan=3).tolist() == [0, 1, 2]
    assert draw(0, 7, seed=0, scan=3).tolist() == []
    assert draw(9, 0, seed=0, scan=3).tolist() == []


@pytest.mark.parametrize(("count", "at_most"), [(50_000, 2000), (2001, 2000), (1_000_003, 999), (3, 2)])
def test_without_replacement_and_within_bounds(count, at_most):
    for scan in range(20):
        drawn = draw(count, at_most, seed=1, scan=scan)
        assert len(drawn) == at_most
        assert (np.diff(drawn) > 0).all()
        assert drawn[0] >= 0
        assert drawn[-1] < count


def test_the_same_scan_and_seed_draw_the_same_and_others_do_not():
    first = draw(10_000, 100, seed=4, scan=8)
    assert (first == draw(10_000, 100, seed=4, scan=8)).all()
    assert (first != draw(10_000, 100, seed=4, scan=9)).any()
    assert (first != draw(10_000, 100, seed=5, scan=8)).any()


def test_every_particle_has_the_same_chance():
    scans, count, at_most = 20_000, 7, 3
    hits = np.bincount(np.concatenate([draw(count, at_most, 0, scan) for scan in range(scans)]), minlength=count)
    expected = scans * at_most / count
    sigma = np.sqrt(scans * (at_most / count) * (1 - at_most / count))
    assert (np.abs(hits - expected) < 5 * sigma).all()


def test_histograms_count_all_and_clamp_the_rest():
    log_weights = np.array([0.0, -np.inf, -1e4, -60.0])
    particles, weight = weight_bars(log_weights - np.logaddexp.reduce(log_weights))
    assert particles.sum() == 100.0
    assert particles[0] == 75.0
    assert weight.sum() == pytest.approx(100.0, abs=0.1)


def test_equal_weights_stand_at_zero():
    n = 1000
    particles, _ = weight_bars(np.full(n, -np.log(n)))
    low, high = palette.HISTOGRAM_RANGE
    width = (high - low) / palette.HISTOGRAM_BINS
    peak = low + particles.argmax() * width
    assert peak - 1e-9 <= 0.0 <= peak + width + 1e-9


def test_heavier_is_never_lighter_in_colour():
    log_weights = np.sort(np.random.default_rng(0).normal(0, 3, 500))
    log_weights -= np.logaddexp.reduce(log_weights)
    levels = palette.weight_levels(log_weights, np.arange(500))
    assert (np.diff(levels) >= 0).all()
    lightness = palette.WEIGHT_COLOURS @ np.array([0.299, 0.587, 0.114])
    assert (np.diff(lightness) < 0).all()
