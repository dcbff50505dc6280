"""Lesson rays: how far a ray goes on a grid before something stops it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipeline.lessons.exam import Array, Function, Question, called, numbers, shaped
from pipeline.lessons.lesson import Lesson, Mistake

RESOLUTION, LONGEST = 0.1, 5.0
"""m: of the map in the cases."""
NEAR, BIASED = 0.5, 0.2
"""Cells by which a single range, and all of them in the mean, may be off: whoever walks along the ray in short steps is
right as well."""
GRAZING = 0.35
"""Cells: a ray that ends elsewhere if it is moved sideways by so much is not asked for."""


def ray_cast(
    occupied: NDArray[np.bool_], x: float, y: float, angle: float, resolution: float, max_range: float
) -> float:
    """How far a ray goes until it enters an occupied cell (Amanatides and Woo 1987; the z* of the book's Table 6.1).

    occupied: (rows, columns) bool. Row i is the cells with y from i * resolution to (i + 1) * resolution, column j
        those with x likewise; the lower left corner of the map is x = 0, y = 0.
    x, y: where the ray begins, m; in a cell that is free.
    angle: where it goes, rad, counter-clockwise from the x axis.
    resolution: the edge of a cell, m. max_range: beyond this nothing is seen, m.
    Returns a float: the distance from the beginning to where the ray enters the first occupied cell, m; max_range
        if it leaves the map before, or would have to go farther than that.
    """
    rows, columns = occupied.shape
    cos, sin = math.cos(angle), math.sin(angle)
    column, row = int(x // resolution), int(y // resolution)
    step_x = 1 if cos > 0 else -1
    step_y = 1 if sin > 0 else -1
    # How far along the ray its next vertical and horizontal cell borders are, and how far apart they are.
    border_x = (column + (step_x > 0)) * resolution
    border_y = (row + (step_y > 0)) * resolution
    next_x = (border_x - x) / cos if cos != 0 else math.inf
    next_y = (border_y - y) / sin if sin != 0 else math.inf
    apart_x = resolution / abs(cos) if cos != 0 else math.inf
    apart_y = resolution / abs(sin) if sin != 0 else math.inf
    while True:
        if next_x < next_y:
            distance, next_x = next_x, next_x + apart_x
            column += step_x
        else:
            distance, next_y = next_y, next_y + apart_y
            row += step_y
        if distance > max_range or not (0 <= column < columns and 0 <= row < rows):
            return max_range
        if occupied[row, column]:
            return distance


def _by_whole_cells(
    occupied: NDArray[np.bool_], x: float, y: float, angle: float, resolution: float, max_range: float
) -> float:
    """The distance between the cells where a ray begins and ends, as Bresenham's line has it."""
    reach = max_range / resolution
    column, row = int(x // resolution), int(y // resolution)
    long = max(1, round(reach * max(abs(math.cos(angle)), abs(math.sin(angle)))))
    for k in range(1, long + 1):
        c = column + round(k * reach * math.cos(angle) / long)
        r = row + round(k * reach * math.sin(angle) / long)
        if not (0 <= c < occupied.shape[1] and 0 <= r < occupied.shape[0]):
            return max_range
        if occupied[r, c]:
            return math.hypot(c - column, r - row) * resolution
    return max_range


def _in_steps(
    occupied: NDArray[np.bool_], x: float, y: float, angle: float, resolution: float, max_range: float, of: float = 1.0
) -> float:
    """In steps of so many cells."""
    rows, columns = occupied.shape
    for k in range(int(max_range / (of * resolution)) + 1):
        distance = k * of * resolution
        column = math.floor((x + distance * math.cos(angle)) / resolution)
        row = math.floor((y + distance * math.sin(angle)) / resolution)
        if not (0 <= column < columns and 0 <= row < rows):
            return max_range
        if occupied[row, column]:
            return distance
    return max_range


class Rays:
    """Rays into all directions, on a map in which no direction looks like another.

    Every one must be as long as it is, to half a cell, and all of them in the mean to a fifth of one.
    """

    @cached_property
    def _cases(self) -> list[tuple[str, tuple[float, float, float], float]]:
        rng = np.random.default_rng([6, 31])
        chosen = []
        for group, directions in _DIRECTIONS.items():
            found = 0
            while found < 9:
                x, y = rng.uniform(0.2, 7.8), rng.uniform(0.2, 5.0)
                angle = float(rng.choice(directions) + rng.uniform(-0.7, 0.7))
                if group.startswith("exactly"):
                    angle = float(rng.choice(directions))
                length = _steady(x, y, angle, LONGEST)
                if group == _NEXT and (length is None or length > 0.9 * RESOLUTION):
                    continue
                if length is None or (length == LONGEST) != (group in (_NOTHING, _BEYOND)):
                    continue
                if group in (_NOTHING, _BEYOND) and (_steady(x, y, angle, 99.0) == 99.0) != (group == _NOTHING):
                    continue
                chosen.append((group, (float(x), float(y), angle), length))
                found += 1
        return chosen

    @cached_property
    def questions(self) -> Sequence[Question]:
        """What each number is."""
        asked = [
            Question(group, f"range from ({x:.2f}, {y:.2f}) m at {math.degrees(angle):.0f} degrees", "m")
            for group, (x, y, angle), _ in self._cases
        ]
        return [*asked, Question("all rays that hit something", "mean of how much too long they are", "m")]

    @cached_property
    def expected(self) -> Array:
        """The way to the border of the cell."""
        return np.array([*(length for _, _, length in self._cases), 0.0])

    @cached_property
    def tolerance(self) -> Array:
        """Half a cell; nothing but rounding where nothing is hit."""
        near = [NEAR * RESOLUTION if length < LONGEST else 1e-3 for _, _, length in self._cases]
        return np.array([*near, BIASED * RESOLUTION])

    def ask(self, function: Function) -> Array:
        """The function's ranges. Raises Unusable."""
        found = []
        for _, (x, y, angle), _ in self._cases:
            arguments = (_map(), x, y, angle, RESOLUTION, LONGEST)
            result = numbers(called(function, arguments), "the range", arguments)
            found.append(float(shaped(result, (), "the range", arguments).reshape(())))
        answers = np.array(found)
        hits = self.expected[:-1] < LONGEST
        return np.append(answers, (answers - self.expected[:-1])[hits].mean())


_NEXT = "rays that begin in the cell next to a wall"
_NOTHING, _BEYOND = "rays that leave the map", "rays that meet something beyond max_range only"
_DIRECTIONS = {
    "to the right": (0.0,),
    "up": (math.pi / 2,),
    "to the left": (math.pi, -math.pi),
    "down": (-math.pi / 2,),
    _NEXT: (0.0, math.pi / 2, math.pi, -math.pi / 2),
    "exactly along an axis": (0.0, math.pi / 2, math.pi, -math.pi / 2),
    _NOTHING: (0.0, math.pi / 2, math.pi, -math.pi / 2),
    _BEYOND: (0.0, math.pi),
}


def _map() -> NDArray[np.bool_]:
    """A map of 8 m by 5.2 m: some blocks, open at parts of its edge."""
    cells = np.zeros((52, 80), np.bool_)
    cells[0, 10:50] = cells[-1, 30:75] = True
    cells[8:40, 0] = cells[20:48, -1] = True
    cells[14:20, 22:26] = cells[30:44, 40:43] = cells[24:28, 58:70] = cells[6:9, 64:66] = True
    return cells


def _steady(x: float, y: float, angle: float, longest: float) -> float | None:
    """The length of a ray that begins on free floor and is about as long if it begins a little to its left or right."""
    cells = _map()
    if cells[int(y / RESOLUTION), int(x / RESOLUTION)]:
        return None
    lengths = []
    for aside in np.linspace(-GRAZING, GRAZING, 15) * RESOLUTION:
        at = (x - aside * math.sin(angle), y + aside * math.cos(angle))
        lengths.append(ray_cast(cells, *at, angle, RESOLUTION, longest))
    length = ray_cast(cells, x, y, angle, RESOLUTION, longest)
    near = np.abs(np.array(lengths) - length) < 0.8 * RESOLUTION
    return length if near.all() and not longest - 0.3 < length < longest else None


LESSON = Lesson(
    name="rays",
    title="Ray casting on a grid",
    source="Probabilistic Robotics, Section 6.3; Amanatides and Woo 1987",
    task=(
        "How far is it to the next wall? Walk along the ray from cell to cell until one is occupied. The exact way "
        "is to go from each border of a cell that the ray crosses to the next one; short steps will do as well, as "
        "long as no range is off by more than half a cell, nor all of them by a fifth of one in the mean. Mind that "
        "rows belong to y, and that Python takes an index of -1 for the last cell."
    ),
    reference=ray_cast,
    exam=Rays(),
    mistakes=(
        Mistake(
            "rows and columns are exchanged",
            {"rows, columns = occupied.shape": "occupied = occupied.T\n    rows, columns = occupied.shape"},
        ),
        Mistake(
            "sine and cosine are exchanged",
            {"cos, sin = math.cos(angle), math.sin(angle)": "cos, sin = math.sin(angle), math.cos(angle)"},
        ),
        Mistake(
            "the angle is taken for degrees",
            {"cos, sin =": "angle = math.radians(angle)\n    cos, sin ="},
        ),
        Mistake(
            "the angle turns clockwise",
            {"cos, sin = math.cos(angle), math.sin(angle)": "cos, sin = math.cos(angle), -math.sin(angle)"},
        ),
        Mistake(
            "rows are counted from the top",
            {"rows, columns = occupied.shape": "occupied = occupied[::-1]\n    rows, columns = occupied.shape"},
        ),
        Mistake(
            "the range is told in cells, and not in metres",
            {"            return distance": "            return distance / resolution"},
        ),
        Mistake(
            "the ray ends where it leaves the occupied cell, one step too late",
            {"            return distance": "            return min(next_x, next_y)"},
        ),
        Mistake(
            "the ray ends one step before the occupied cell",
            {
                "distance, next_x = next_x,": "distance, next_x = next_x - min(apart_x, apart_y),",
                "distance, next_y = next_y,": "distance, next_y = next_y - min(apart_x, apart_y),",
            },
        ),
        Mistake(
            "the distance counts whole cells, from centre to centre, as Bresenham's line does",
            {
                "    rows, columns = occupied.shape": "    return _by_whole_cells(occupied, x, y, angle, "
                "resolution, max_range)\n    rows, columns = occupied.shape"
            },
        ),
        Mistake(
            "the steps along the ray are a whole cell long, which is too coarse",
            {
                "    rows, columns = occupied.shape": "    return _in_steps(occupied, x, y, angle, resolution, "
                "max_range)\n    rows, columns = occupied.shape"
            },
        ),
        Mistake(
            "the steps along the ray are half a cell long, which is too coarse",
            {
                "    rows, columns = occupied.shape": "    return _in_steps(occupied, x, y, angle, resolution, "
                "max_range, 0.5)\n    rows, columns = occupied.shape"
            },
        ),
        Mistake(
            "a ray that leaves the map comes in again on the other side: an index below 0 is the last cell",
            {"0 <= column < columns and 0 <= row": "column < columns and row"},
        ),
        Mistake(
            "a ray that leaves the map ends at its edge, where it should see nothing",
            {"            return max_range": "            return min(distance, max_range)"},
        ),
        Mistake("a range beyond max_range is returned as it is", {"distance > max_range or not (0": "not (0"}),
        Mistake(
            "infinity is returned where nothing is met, and not max_range",
            {"            return max_range": "            return math.inf"},
        ),
        Mistake("the map's free cells stop the ray", {"if occupied[row, column]": "if not occupied[row, column]"}),
        Mistake(
            "where the ray begins is rounded to a corner of its cell",
            {"    step_x = 1 if": "    x, y = column * resolution, row * resolution\n    step_x = 1 if"},
        ),
        Mistake("the next border is always the one to the right, also for rays to the left", {"(step_x > 0)": "1"}),
        Mistake(
            "sine and cosine are exchanged in x only",
            {"cos, sin = math.cos(angle), math": "cos, sin = math.sin(angle), math"},
        ),
        Mistake("sine and cosine are exchanged in y only", {"math.sin(angle)": "math.cos(angle)"}),
        Mistake("a ray to the left goes to the right", {"-1\n    step_y": "1\n    step_y"}),
        Mistake("a ray down goes up", {"1 if sin > 0 else -1": "1"}),
        Mistake(
            "of the two borders ahead the farther one is crossed first", {"if next_x < next_y": "if next_x > next_y"}
        ),
        Mistake(
            "the cell in which the ray begins is the next one: metres are rounded up",
            {"int(x // resolution), int(y // resolution)": "int(x // resolution) + 1, int(y // resolution) + 1"},
        ),
        Mistake(
            "the first row and the first column of the map are left out",
            {"0 <= column < columns and 0 <= row": "0 < column < columns and 0 < row"},
        ),
    ),
)
