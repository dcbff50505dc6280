"""The ends of beams that were measured one after the other from a moving laser, put where one place would see them."""

from __future__ import annotations

import math

import numpy as np

from pipeline.kernels import inline, kernel

STEEPEST = 6.0
"""Two beams end on one surface if the step between them is no steeper than this: a wall at 80 degrees to the beam."""
ROUGH = 0.05
"""m by which the readings of one surface may differ besides: noise, and what is not quite flat."""
WIDEST = 0.5
"""rad between two beams beyond which nobody knows what is between them."""
ASIDE = 1.0
"""Beams: across an edge the nearer neighbour counts if it is no farther aside than this."""
_STRAIGHT = 1e-9  # rad: an arc that turns less is a line


@inline
def _small_arctangent(aside, along):
    """atan2, by the first terms of its series where they say it to 1e-8."""
    if abs(aside) < 0.2 * along:
        t = aside / along
        tt = t * t
        return t * (1.0 - tt * (1 / 3 - tt * (1 / 5 - tt * (1 / 7 - tt * (1 / 9 - tt * (1 / 11))))))
    return math.atan2(aside, along)


@inline
def _small_sine(x):
    """sin(x) by the first terms of its series: to 2e-6 up to WIDEST."""
    xx = x * x
    return x * (1.0 - xx * (1 / 6) * (1.0 - xx * (1 / 20)))


@kernel
def carry(ranges, angle_min, step, backward, x, y, turn, range_min, range_max, out):
    """Ranges (n,) float32 m of beams one after the other into ``out`` (n,) float32, as seen from the first one's place.

    Beam k points at ``angle_min + k * step`` rad; with ``backward`` the last is measured first. The laser moved by
    ``x, y`` m and ``turn`` rad, in its own frame and at constant velocity, from the first measured to the last. NaN:
    nothing measured; inf, and what is beyond ``range_max``: no return; what is below ``range_min`` is NaN.

    A regular beam between two neighbours ends on the line through their ends where both are on one surface, else it is
    as long as the nearer of them. What is nearer hides what is behind it; a direction seen again at the end of a full
    turn adds what was not seen at its beginning.
    """
    n = ranges.shape[0]
    each = -step if backward else step  # from beam to beam as they are measured, which is how i and j count them
    turn_each, share_each, period = turn / (n - 1), 1.0 / (n - 1), 2.0 * math.pi / abs(step)
    per_each, spread = 1.0 / each, 1.0 + turn_each / each  # beams per rad; their distance now, in beams
    # Constant velocity is an arc; (u, v) is its velocity over the whole scan.
    straight = abs(turn) < _STRAIGHT
    slow = 1.0 if straight else 0.5 * turn / math.tan(0.5 * turn)
    u, v = slow * x + 0.5 * turn * y, slow * y - 0.5 * turn * x
    per_turn = 0.0 if straight else 1.0 / turn
    # Along the beam that is measured, in the frame of the stamp; and how far the laser has turned by then.
    cos, sin = math.cos(angle_min + (n - 1) * step), math.sin(angle_min + (n - 1) * step)
    if not backward:
        cos, sin = math.cos(angle_min), math.sin(angle_min)
    cos_step, sin_step = math.cos(each + turn_each), math.sin(each + turn_each)
    cos_turned, sin_turned, cos_turn, sin_turn = 1.0, 0.0, math.cos(turn_each), math.sin(turn_each)
    out[:] = np.nan
    # The neighbour before: its place among the regular beams, its length now, and as it was measured.
    before, q0, r0, measured0 = -1, 0.0, 0.0, 0.0
    for i in range(n + 1):
        measured1 = float(ranges[n - 1 - i if backward else i]) if i < n else np.nan
        q1, r1 = i * spread, measured1
        if measured1 < np.inf:
            if straight:
                there_x, there_y = i * share_each * u, i * share_each * v
            else:
                there_x = (sin_turned * u - (1.0 - cos_turned) * v) * per_turn
                there_y = ((1.0 - cos_turned) * u + sin_turned * v) * per_turn
            along, aside = measured1 + cos * there_x + sin * there_y, cos * there_y - sin * there_x
            q1 += _small_arctangent(aside, along) * per_each
            r1 = math.sqrt(along * along + aside * aside)
        cos, sin = cos * cos_step - sin * sin_step, sin * cos_step + cos * sin_step
        was_cos = cos_turned
        cos_turned, sin_turned = was_cos * cos_turn - sin_turned * sin_turn, sin_turned * cos_turn + was_cos * sin_turn
        if (i < n and np.isnan(measured1)) or (i == n and before < 0):
            continue
        gap, flat, open_space = i - before, False, False
        if before < 0:  # beyond the ends of what was measured, half a beam counts
            q0, r0, gap = q1 - 0.5, r1, 1
        elif i == n:
            q1, r1, gap = q0 + 0.5, r0, 1
        else:
            open_space = gap == 1 and r0 == np.inf and r1 == np.inf
            steep = STEEPEST * gap * abs(step) * min(measured0, measured1) + ROUGH
            flat = abs(measured1 - measured0) <= steep and (q1 - q0) * abs(step) < WIDEST
        reach = ASIDE if gap == 1 else 0.5 * (q1 - q0) / gap
        for lap in range(2 if q1 > period else 1):
            first, end = max(math.ceil(q0 - lap * period), 0), min(math.ceil(q1 - lap * period), n)
            for j in range(first, end):
                back, on = j + lap * period - q0, q1 - lap * period - j
                if not (min(back, on) <= reach or open_space or (flat and gap == 1)):
                    continue
                reading = r0 if back <= on else r1
                if flat:  # the ray meets the line through both ends: by the areas of three triangles
                    areas = _small_sine(back * step) * r0 + _small_sine(on * step) * r1
                    reading = _small_sine((q1 - q0) * step) * r0 * r1 / areas
                k = n - 1 - j if backward else j
                if np.isnan(out[k]) or (lap == 0 and reading < out[k]):
                    out[k] = reading
        before, q0, r0, measured0 = i, q1, r1, measured1
    for k in range(n):
        if out[k] > range_max:
            out[k] = np.inf
        elif out[k] < range_min:
            out[k] = np.nan
