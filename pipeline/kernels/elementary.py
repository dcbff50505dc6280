"""Elementary functions in single precision, free of branches: in a loop they become vector instructions.

A library's cosine takes longer than all else that is done to move a particle, its exponential longer than the beams.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.kernels import inline

_F = np.float32
_QUARTERS = _F(2.0 / math.pi)
# A quarter turn in three parts (Cody and Waite), the first ones of few digits: their multiples are exact.
_PART1, _PART2, _PART3 = _F(1.5703125), _F(4.837512969970703e-4), _F(7.549789948768648e-8)
_TURN, _HALF_TURN = 2.0 * math.pi, _F(math.pi)


@inline
def sine_cosine(angle):
    """Both at once of a float32 angle in rad: wrong by 1e-7 at most up to some hundred turns (polynomials: Cephes)."""
    quarters = np.floor(angle * _QUARTERS + _F(0.5))
    r = ((angle - quarters * _PART1) - quarters * _PART2) - quarters * _PART3
    rr = r * r
    sine = r + r * rr * (_F(-1.6666654611e-1) + rr * (_F(8.3321608736e-3) + rr * _F(-1.9515295891e-4)))
    cosine = (_F(1.0) - _F(0.5) * rr) + rr * rr * (
        _F(4.166664568298827e-2) + rr * (_F(-1.388731625493765e-3) + rr * _F(2.443315711809948e-5))
    )
    quarter = np.int32(quarters)
    swapped = (quarter & 1) != 0
    s, c = (cosine if swapped else sine), (sine if swapped else cosine)
    return (-s if (quarter & 2) != 0 else s), (-c if ((quarter + 1) & 2) != 0 else c)


@inline
def wrapped(angle):
    """A float32 angle within [-pi, pi), whatever number of turns away; in double, since there may be many."""
    within = _F(angle - _TURN * np.floor((angle + math.pi) * (1.0 / _TURN)))
    # Rounded up to the border, or past it.
    within = within if within < _HALF_TURN else -_HALF_TURN
    return within if within >= -_HALF_TURN else -_HALF_TURN


@inline
def exponential(x):
    """exp(x) of a float32 x <= 0, by the sixth square of a polynomial.

    Wrong by 5e-6 at most, and by 2 in 1000 of itself down to exp(-30); what is below exp(-60) is nothing.
    """
    y = max(x * _F(1.0 / 64.0), _F(-1.0))
    e = _F(1.0) + y * (_F(1.0) + y * (_F(1 / 2) + y * (_F(1 / 6) + y * (_F(1 / 24) + y * _F(1 / 120)))))
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    return e if y > _F(-60.0 / 64.0) else _F(0.0)


@inline
def sum_of(values, first, last):
    """Their sum, four at a time, in double: one sum would wait for each of its own additions."""
    s0 = s1 = s2 = s3 = 0.0
    fours = first + (last - first) // 4 * 4
    for i in range(first, fours, 4):
        s0, s1, s2, s3 = s0 + values[i], s1 + values[i + 1], s2 + values[i + 2], s3 + values[i + 3]
    for i in range(fours, last):
        s0 += values[i]
    return (s0 + s1) + (s2 + s3)


@inline
def largest_of(values):
    """The largest of float32 ``values``, four at a time."""
    n = values.shape[0]
    m0 = m1 = m2 = m3 = _F(-np.inf)
    for i in range(0, n // 4 * 4, 4):
        m0, m1, m2, m3 = max(m0, values[i]), max(m1, values[i + 1]), max(m2, values[i + 2]), max(m3, values[i + 3])
    for i in range(n // 4 * 4, n):
        m0 = max(m0, values[i])
    return max(max(m0, m1), max(m2, m3))
