"""The normal distribution, without waiting for scipy to load."""

from __future__ import annotations

import math

import numpy as np

from pipeline.kernels import inline, kernel

NOTHING = 38.0
"""So many standard deviations below the mean there is nothing that a double could hold."""
_A = np.array([3.3871328727963666080, 133.14166789178437745, 1971.5909503065514427, 13731.693765509461125,
               45921.953931549871457, 67265.770927008700853, 33430.575583588128105, 2509.0809287301226727])  # fmt: skip
_B = np.array([1.0, 42.313330701600911252, 687.18700749205790830, 5394.1960214247511077, 21213.794301586595867,
               39307.895800092710610, 28729.085735721942674, 5226.4952788528545610])  # fmt: skip
_C = np.array([1.42343711074968357734, 4.63033784615654529590, 5.76949722146069140550, 3.64784832476320460504,
               1.27045825245236838258, 0.241780725177450611770, 0.0227238449892691845833,
               7.74545014278341407640e-4])  # fmt: skip
_D = np.array([1.0, 2.05319162663775882187, 1.67638483018380384940, 0.689767334985100004550, 0.148103976427480074590,
               0.0151986665636164571966, 5.47593808499534494600e-4, 1.05075007164441684324e-9])  # fmt: skip


@inline
def _ratio(upper, lower, x):
    above = below = 0.0
    for k in range(7, -1, -1):
        above = above * x + upper[k]
        below = below * x + lower[k]
    return above / below


@kernel
def distribution(x, out):
    """The share of a standard normal below each of ``x`` (n,) float64 -> ``out`` (n,)."""
    for i in range(x.shape[0]):
        if x[i] < -NOTHING:
            out[i] = 0.0
        elif x[i] > 9.0:
            out[i] = 1.0
        else:
            out[i] = 0.5 * math.erfc(-x[i] * math.sqrt(0.5))


@kernel
def quantiles(p, out):
    """Where a standard normal has the shares ``p`` (n,) float64 below it, from 1e-11 to 1 - 1e-11 -> ``out`` (n,).

    Wichura's algorithm AS 241 (Applied Statistics, 1988), good to 16 digits.
    """
    for i in range(p.shape[0]):
        q = p[i] - 0.5
        if abs(q) <= 0.425:
            out[i] = q * _ratio(_A, _B, 0.180625 - q * q)
        else:
            r = math.sqrt(-math.log(min(p[i], 1.0 - p[i])))
            out[i] = math.copysign(_ratio(_C, _D, r - 1.6), q)
