"""What the quick kernels are measured against must be right as well, or its time means nothing."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.config import Config
from pipeline.filter.beam_model import mixture_density
from pipeline.kernels.baseline import score_plainly


def test_it_is_the_mixture_of_the_book() -> None:
    rng = np.random.default_rng(0)
    config = Config(z_long=0.0, z_hit=0.6, z_short=0.2, z_max=0.1, z_rand=0.1)
    longest, offsets = 30.0, np.array([0, 40, 170], np.int32)
    row_of_cell = np.full((5, 6), -1, np.int32)
    row_of_cell[1:4, 1:5] = np.arange(12).reshape(3, 4)
    ranges = rng.uniform(3.0, 20.0, (12, 360)).astype(np.float32)
    measured = np.array([5.0, np.inf, 18.5], np.float32)
    weights = config.z_hit, config.z_short, config.z_max, config.z_rand, config.sigma_hit, config.lambda_short
    place = (np.float32(0), np.float32(0), np.float32(0), np.float32(1.0), 360, row_of_cell)
    x, y, theta = np.array([[1.5, 4.2, 0.5], [2.5, 3.9, 0.5], [0.0, np.pi / 2, 0.0]], np.float32)
    for work in (0, 10**9):
        out = np.empty(3, np.float32)
        rest = (ranges, offsets, measured, np.array(weights), longest, np.float32(-77.0), out)
        score_plainly(work, x, y, theta, *place, *rest)
        for found, row, heading in zip(out, (4, 11), (0, 90), strict=False):
            true = ranges[row, (heading + offsets) % 360]
            density = mixture_density(measured[[0, 2]], true[[0, 2]], config, longest)
            assert found == pytest.approx(np.log(density).sum() + np.log(config.z_max), abs=1e-4)
        assert out[2] == -77.0
