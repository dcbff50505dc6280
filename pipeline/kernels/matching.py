"""Where on a patch of remembered walls does a scan fit? Point-to-line, and by trying every place in a window."""

from __future__ import annotations

import math

import numpy as np

from pipeline.kernels import inline, kernel

FACING = 0.5
"""Cosine of the largest angle between a wall as it is seen and as it is remembered: walls have two sides."""


@kernel
def enter(points, first, last, cells, inverse_cell, reach):
    """Let the cells around the points ``first`` to ``last`` know them, unless they know a nearer one.

    ``points`` (4, capacity) float32: x, y (m) and the normal; ``cells`` (n, n) int32, n a power of two: the index of
    the point nearest to a cell's centre, -1 for none within ``reach`` m. The plane is wound up on ``cells``: places n
    cells apart share one.
    """
    mask = cells.shape[0] - 1
    size, around = 1.0 / inverse_cell, int(math.ceil(reach * inverse_cell))
    for i in range(first, last):
        x, y = float(points[0, i]), float(points[1, i])
        col, row = int(math.floor(x * inverse_cell)), int(math.floor(y * inverse_cell))
        for r in range(row - around, row + around + 1):
            dy = (r + 0.5) * size - y
            for c in range(col - around, col + around + 1):
                dx = (c + 0.5) * size - x
                far = dx * dx + dy * dy
                if far > reach * reach:
                    continue
                known = cells[r & mask, c & mask]
                if known >= 0:
                    ox, oy = (c + 0.5) * size - points[0, known], (r + 0.5) * size - points[1, known]
                    if ox * ox + oy * oy <= far:
                        continue
                cells[r & mask, c & mask] = i


@inline
def nearest(x, y, points, cells, inverse_cell):
    """Index of the remembered point near (x, y), and its squared distance; -1 if there is none."""
    mask = cells.shape[0] - 1
    i = cells[int(math.floor(y * inverse_cell)) & mask, int(math.floor(x * inverse_cell)) & mask]
    far = math.inf
    if i >= 0:
        dx, dy = x - points[0, i], y - points[1, i]
        far = dx * dx + dy * dy
    return i, far


@kernel
def align(seen, n, guess, points, cells, inverse_cell, reach, scale, pose, normal):
    """Point-to-line match (Censi's PLICP, 2008, with a robust weight) of a scan to remembered walls.

    ``seen`` (4, >= n) float32: points and normals in the robot's frame; ``guess`` (3,) where the search starts -> the
    ``pose`` (3,) at which it ends, and ``normal`` (3, 3): the weighted normal equations there, in units of ``scale``
    squared. Pairs farther apart than a limit, which shrinks from ``reach`` to 3 ``scale``, are left out. Returns how
    well it fits: the mean over all points of exp(-e^2 / 2 scale^2), e the distance from the line.
    """
    x, y, yaw = guess[0], guess[1], guess[2]
    limit, width = reach, max(scale, 0.5 * reach)
    h = np.empty(6)
    for turn in range(25):
        h[:] = 0.0
        b0, b1, b2 = 0.0, 0.0, 0.0
        c, s = math.cos(yaw), math.sin(yaw)
        least = limit * limit
        for k in range(n):
            rx, ry = c * seen[0, k] - s * seen[1, k], s * seen[0, k] + c * seen[1, k]
            i, far = nearest(x + rx, y + ry, points, cells, inverse_cell)
            if far > least:
                continue
            nx, ny = points[2, i], points[3, i]
            if nx * (c * seen[2, k] - s * seen[3, k]) + ny * (s * seen[2, k] + c * seen[3, k]) < FACING:
                continue
            e = nx * (x + rx - points[0, i]) + ny * (y + ry - points[1, i])
            w = 1.0 / (1.0 + (e / width) ** 2)
            w *= w
            lever = ny * rx - nx * ry
            h[0] += w * nx * nx
            h[1] += w * nx * ny
            h[2] += w * ny * ny
            h[3] += w * nx * lever
            h[4] += w * ny * lever
            h[5] += w * lever * lever
            b0 -= w * nx * e
            b1 -= w * ny * e
            b2 -= w * lever * e
        # Three unknowns, by Cramer's rule; a little of the unit matrix where nothing holds a direction.
        a00, a11, a22 = h[0] + 1e-3, h[2] + 1e-3, h[5] + 1e-3
        m00, m01, m02 = a11 * a22 - h[4] * h[4], h[3] * h[4] - h[1] * a22, h[1] * h[4] - h[3] * a11
        det = a00 * m00 + h[1] * m01 + h[3] * m02
        dx = (m00 * b0 + m01 * b1 + m02 * b2) / det
        dy = (m01 * b0 + (a00 * a22 - h[3] * h[3]) * b1 + (h[1] * h[3] - a00 * h[4]) * b2) / det
        dyaw = (m02 * b0 + (h[1] * h[3] - a00 * h[4]) * b1 + (a00 * a11 - h[1] * h[1]) * b2) / det
        x, y, yaw = x + dx, y + dy, yaw + dyaw
        small = max(abs(dx), abs(dy), abs(dyaw))
        if width <= scale and small < 2e-4:
            break
        if small < 0.05 or turn > 8:
            limit, width = max(3.0 * scale, 0.6 * limit), max(scale, 0.5 * width)
    pose[0], pose[1], pose[2] = x, y, yaw
    normal[0, 0], normal[1, 1], normal[2, 2] = h[0], h[2], h[5]
    normal[0, 1] = normal[1, 0] = h[1]
    normal[0, 2] = normal[2, 0] = h[3]
    normal[1, 2] = normal[2, 1] = h[4]
    return fit(seen, n, pose, points, cells, inverse_cell, scale)


@kernel
def fit(seen, n, pose, points, cells, inverse_cell, scale):
    """How well a scan fits at a pose (3,): the mean of its points' exp(-e^2 / 2 scale^2), 0 where no wall is near."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    total, least = 0.0, (6.0 * scale) ** 2
    for k in range(n):
        px, py = pose[0] + c * seen[0, k] - s * seen[1, k], pose[1] + s * seen[0, k] + c * seen[1, k]
        i, far = nearest(px, py, points, cells, inverse_cell)
        if far > least:
            continue
        nx, ny = points[2, i], points[3, i]
        if nx * (c * seen[2, k] - s * seen[3, k]) + ny * (s * seen[2, k] + c * seen[3, k]) < FACING:
            continue
        e = (nx * (px - points[0, i]) + ny * (py - points[1, i])) / scale
        total += math.exp(-0.5 * e * e)
    return total / max(n, 1)


@kernel
def sweep(seen, n, centre, half_width, step, half_angle, angle_step, points, cells, inverse_cell, near, poses, scores):
    """A correlative match (Olson, 2009): every place in a window, by the share of points within ``near`` m of a wall.

    Around ``centre`` (3,), for each heading in steps of ``angle_step`` rad: first every second ``step`` (m), by the
    share of points in cells that know of any wall; then around the best of these by the distance -> ``poses`` (a, 3)
    and their ``scores`` (a,), which are a little less the farther away they are.
    """
    mask = cells.shape[0] - 1
    far = int(round(0.5 * half_width / step))  # in double steps
    stride = int(round(2.0 * step * inverse_cell))
    rx, ry = np.empty(n), np.empty(n)
    col, row = np.empty(n, np.int64), np.empty(n, np.int64)
    for a in range(poses.shape[0]):
        yaw = centre[2] - half_angle + a * angle_step
        c, s = math.cos(yaw), math.sin(yaw)
        for k in range(n):
            rx[k] = centre[0] + c * seen[0, k] - s * seen[1, k]
            ry[k] = centre[1] + s * seen[0, k] + c * seen[1, k]
            col[k], row[k] = int(math.floor(rx[k] * inverse_cell)), int(math.floor(ry[k] * inverse_cell))
        most, best_i, best_j = -1, 0, 0
        for i in range(-far, far + 1):
            for j in range(-far, far + 1):
                hits = 0
                for k in range(n):
                    hits += cells[(row[k] + i * stride) & mask, (col[k] + j * stride) & mask] >= 0
                # Of equal ones the nearest: the loops begin far away.
                if hits > most or (hits == most and i * i + j * j < best_i * best_i + best_j * best_j):
                    most, best_i, best_j = hits, i, j
        best = -1.0
        for i in range(2 * best_i - 2, 2 * best_i + 3):
            for j in range(2 * best_j - 2, 2 * best_j + 3):
                hits = 0
                for k in range(n):
                    _, away = nearest(rx[k] + j * step, ry[k] + i * step, points, cells, inverse_cell)
                    hits += away <= near * near
                score = hits / n - 1e-3 * (step * (abs(i) + abs(j)) + abs(yaw - centre[2]))
                if score > best:
                    best = score
                    poses[a, 0], poses[a, 1], poses[a, 2] = centre[0] + j * step, centre[1] + i * step, yaw
        scores[a] = best


@kernel
def carry(seen, pose, out):
    """Points and normals (4, n) float32 of the robot's frame, carried to where a pose (3,) sees them -> ``out``."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for k in range(seen.shape[1]):
        out[0, k] = pose[0] + c * seen[0, k] - s * seen[1, k]
        out[1, k] = pose[1] + s * seen[0, k] + c * seen[1, k]
        out[2, k] = c * seen[2, k] - s * seen[3, k]
        out[3, k] = s * seen[2, k] + c * seen[3, k]
