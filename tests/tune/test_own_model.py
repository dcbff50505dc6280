"""A beam model of the user's own is learned like the built-in one: from what the laser measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.config import load_config
from pipeline.tune.em import Readings
from pipeline.tune.own_model import fit_own_model, learnable

LAPLACE = '''
import numpy as np

def density(z, expected, max_range, spread=0.5, hits=0.5, heavy=True, times=3):
    """Laplace's distribution, and anything."""
    if not (0 < hits < 1):
        raise ValueError("hits is a share")
    near = np.exp(-np.abs(z - expected) / spread) / (2 * spread)
    return hits * np.where(np.isfinite(expected), near, 0.0) + (1 - hits) / max_range
'''


def test_its_numbers_are_found_again(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(LAPLACE)
    config = load_config(None, [f"sensor_model={tmp_path}/mine.py:density", "range_bias=0"])
    assert learnable(config) == ["sensor_model.spread", "sensor_model.hits"]
    rng, n = np.random.default_rng(4), (200, 60)
    expected = rng.uniform(1.0, 9.0, n)
    hit = rng.random(n) < 0.8
    measured = np.where(hit, np.clip(rng.laplace(expected, 0.1), 0.0, 10.0), rng.uniform(0.0, 10.0, n))
    fit = fit_own_model([Readings(measured, expected, 10.0)], config)
    assert fit.config.own["sensor_model.spread"] == pytest.approx(0.1, rel=0.06)
    assert fit.config.own["sensor_model.hits"] == pytest.approx(0.8, rel=0.04)
    assert fit.config.own["sensor_model.times"] == 3
    assert (np.diff(fit.history) >= 0).all()


def test_the_built_in_model_has_nothing_of_the_sort() -> None:
    assert learnable(load_config()) == []
