"""The surfaces that a scan saw: where beams ended, and which way the wall faces there."""

from __future__ import annotations

import math

import numpy as np

from pipeline.kernels import kernel

SIDE = 24
"""Beams on either side that a line is fitted to, at most: enough for the finest lasers."""


@kernel
def surfaces(ranges, cosines, sines, x0, y0, longest, increment, window, thickness, spacing, out):
    """Points on straight pieces of wall with their normals, ``spacing`` apart -> ``out`` (4, beams) float32; how many.

    ``ranges`` (n,) float32 m, those not finite or above ``longest`` are passed over; ``cosines, sines`` (n,) of the
    beams on the robot, ``increment`` rad between them; ``x0, y0`` the laser on the robot. Each point is moved onto the
    line through its neighbours within ``window`` m; where these lie farther than ``thickness`` (m, RMS) off their line
    there is no point. Rows of ``out``: x, y of the point, x, y of the unit normal, which faces the laser.
    """
    n = ranges.shape[0]
    x, y, there = np.empty(n), np.empty(n), np.empty(n, np.bool_)
    for k in range(n):
        r = float(ranges[k])
        there[k] = math.isfinite(r) and 0.0 < r <= longest
        x[k], y[k] = (x0 + r * cosines[k], y0 + r * sines[k]) if there[k] else (0.0, 0.0)
    linked = np.zeros(n, np.bool_)  # whether beam k and k + 1 may have met the same wall
    for k in range(n - 1):
        if there[k] and there[k + 1]:
            gap = 0.1 + min(0.4, 3.0 * increment * min(ranges[k], ranges[k + 1]))
            linked[k] = (x[k + 1] - x[k]) ** 2 + (y[k + 1] - y[k]) ** 2 <= gap * gap
    m, last_x, last_y = 0, math.inf, math.inf
    for k in range(n):
        if not there[k] or (x[k] - last_x) ** 2 + (y[k] - last_y) ** 2 < spacing * spacing:
            continue
        a = b = k
        while a > 0 and linked[a - 1] and k - a < SIDE and (a == k or _near(x, y, a - 1, k, window)):
            a -= 1
        while b < n - 1 and linked[b] and b - k < SIDE and (b == k or _near(x, y, b + 1, k, window)):
            b += 1
        if a == b:
            continue
        count, mx, my = b - a + 1, 0.0, 0.0
        for j in range(a, b + 1):
            mx += x[j]
            my += y[j]
        mx, my = mx / count, my / count
        xx, xy, yy = 0.0, 0.0, 0.0
        for j in range(a, b + 1):
            dx, dy = x[j] - mx, y[j] - my
            xx += dx * dx
            xy += dx * dy
            yy += dy * dy
        # The axes of the neighbours' scatter: along the wall, and across it.
        off = (xx + yy) / 2.0 - math.hypot((xx - yy) / 2.0, xy)
        if off > thickness * thickness * count:
            continue
        along = 0.5 * math.atan2(2.0 * xy, xx - yy)
        nx, ny = -math.sin(along), math.cos(along)
        if nx * (x0 - x[k]) + ny * (y0 - y[k]) < 0.0:
            nx, ny = -nx, -ny
        away = nx * (x[k] - mx) + ny * (y[k] - my)
        out[0, m], out[1, m] = x[k] - away * nx, y[k] - away * ny
        out[2, m], out[3, m] = nx, ny
        m += 1
        last_x, last_y = x[k], y[k]
    return m


@kernel
def _near(x, y, a, b, window):
    return (x[a] - x[b]) ** 2 + (y[a] - y[b]) ** 2 <= window * window
