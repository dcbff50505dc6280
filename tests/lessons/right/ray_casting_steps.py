import numpy as np


def ray_cast(occupied, x, y, angle, resolution, max_range):
    """All places along the ray at once, a tenth of a cell apart."""
    r = np.arange(0, max_range, resolution / 10)
    column = np.floor((x + r * np.cos(angle)) / resolution).astype(int)
    row = np.floor((y + r * np.sin(angle)) / resolution).astype(int)
    inside = (row >= 0) & (column >= 0) & (row < occupied.shape[0]) & (column < occupied.shape[1])
    hit = np.flatnonzero(inside & occupied[row * inside, column * inside])
    return np.float32(r[hit[0]]) if len(hit) else max_range
