"""What the quick kernels are measured against: the same sum as anybody would write it first."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pipeline.kernels import paired
from pipeline.kernels.scoring import table_place


@paired
def score_plainly(x, y, theta, laser_x, laser_y, laser_yaw, inv_resolution, headings, row_of_cell, ranges, offsets,
                  measured, mixture, max_range, outside, out):  # fmt: skip
    """Log-likelihood of a scan at every particle: per beam a true range is read, and the density worked out.

    As ``scoring.score``, but with ``ranges`` (n, headings) float32 m, ``measured`` (k,) float32 m, inf for no return,
    and ``mixture`` (6,) float64: z_hit, z_short, z_max, z_rand, sigma_hit, lambda_short of Table 6.1; hits are
    normalised as if all of them lay within the range -> ``out`` (n,) float32.
    """
    height, width = row_of_cell.shape
    flat = row_of_cell.reshape(-1)
    hit, short, none, rand, sigma, rate = mixture
    peak = hit / (sigma * math.sqrt(2.0 * math.pi))
    for i in prange(x.shape[0]):
        cell, heading = table_place(
            x[i], y[i], theta[i], laser_x, laser_y, laser_yaw, inv_resolution, headings, height, width
        )
        row = flat[cell] if cell >= 0 else np.int32(-1)
        if row < 0:
            out[i] = outside
            continue
        total = 0.0
        for k in range(offsets.shape[0]):
            true, z = ranges[row, (heading + offsets[k]) % headings], measured[k]
            if z == np.inf:
                total += math.log(none)
                continue
            density = rand / max_range + peak * math.exp(-0.5 * ((z - true) / sigma) ** 2)
            if z <= true:
                density += short * rate * math.exp(-rate * z) / (1.0 - math.exp(-rate * true))
            total += math.log(density)
        out[i] = total
