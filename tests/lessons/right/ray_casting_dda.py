import math


def ray_cast(occupied, x, y, angle, resolution, max_range):
    """From border to border, in units of cells."""
    rows, columns = occupied.shape
    x, y, far = x / resolution, y / resolution, max_range / resolution
    dx, dy = math.cos(angle), math.sin(angle)
    column, row = math.floor(x), math.floor(y)
    travelled = 0.0
    while not occupied[row, column]:
        to_x = ((column + 1 - x) if dx > 0 else (column - x)) / dx if dx != 0 else math.inf
        to_y = ((row + 1 - y) if dy > 0 else (row - y)) / dy if dy != 0 else math.inf
        if to_x < to_y:
            travelled = to_x
            column += 1 if dx > 0 else -1
        else:
            travelled = to_y
            row += 1 if dy > 0 else -1
        if travelled > far or column < 0 or row < 0 or column >= columns or row >= rows:
            return max_range
    return travelled * resolution
