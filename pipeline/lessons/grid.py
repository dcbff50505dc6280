"""Lesson 8.1: one step of grid localization."""

from __future__ import annotations

import numpy as np

from pipeline.lessons.exam import Array, Case, Exact, Returned
from pipeline.lessons.lesson import Lesson, Mistake

CELLS = 7
"""Cells in every case."""


def grid_localization(belief: Array, motion: Array, likelihood: Array) -> Array:
    """Move and correct a belief over cells (Probabilistic Robotics, Table 8.1).

    belief: (n,) float64, the probability of each cell before the step; they sum to one.
    motion: (n, n) float64. motion[k, i] is how probable it is that the robot comes to cell k if it is in cell i,
        given what the odometry says.
    likelihood: (n,) float64, the likelihood of the scan in each cell, which is not normalised.
    Returns (n,): the probability of each cell after the step; they sum to one.
    """
    n = len(belief)
    moved = np.zeros(n)
    for k in range(n):
        for i in range(n):
            moved[k] += motion[k, i] * belief[i]
    posterior = likelihood * moved
    return np.asarray(posterior / posterior.sum())


def _case(group: str, seed: int, belief: Array | None = None, shift: int = 0) -> Case:
    rng = np.random.default_rng([8, 1, seed])
    start = rng.dirichlet(np.ones(CELLS)) if belief is None else belief
    motion = rng.dirichlet(np.ones(CELLS), CELLS).T if shift == 0 else np.roll(np.eye(CELLS), shift, axis=0)
    rows = tuple(f"probability of cell {k}" for k in range(CELLS))
    return Case(group, (start, motion, rng.uniform(0.01, 3.0, CELLS)), rows)


LESSON = Lesson(
    name="8.1",
    title="Grid localization",
    source="Probabilistic Robotics, Section 8.2 and Table 8.1",
    task=(
        "The belief is a probability for every cell. First the robot moves: the new probability of a cell is the "
        "sum, over all cells in which it may have been, of the old probability times that of coming from there. "
        "Then the scan weighs each cell by its likelihood, and all of them are divided by their sum."
    ),
    reference=grid_localization,
    exam=Exact(
        grid_localization,
        [Returned("probability")],
        [
            _case("the robot may move anywhere", 0),
            _case("the robot may move anywhere", 1),
            _case("the place before the move is known", 2, np.eye(CELLS)[2]),
            _case("every cell moves to the next one", 3, shift=1),
            _case("every cell moves to the one before it", 4, shift=-1),
        ],
    ),
    mistakes=(
        Mistake("the result is not normalised", {"posterior / posterior.sum()": "posterior"}),
        Mistake(
            "the indices of the motion are exchanged: the way from k to i, and not from i to k",
            {"motion[k, i] * belief[i]": "motion[i, k] * belief[i]"},
        ),
        Mistake(
            "the old probability is that of the new cell, and not of the one that the robot came from",
            {"motion[k, i] * belief[i]": "motion[k, i] * belief[k]"},
        ),
        Mistake(
            "the scan weighs the cells before the move, and not after it",
            {
                "motion[k, i] * belief[i]": "motion[k, i] * likelihood[i] * belief[i]",
                "posterior = likelihood * moved": "posterior = moved",
            },
        ),
        Mistake("the scan is left out", {"posterior = likelihood * moved": "posterior = moved"}),
        Mistake("the move is left out", {"posterior = likelihood * moved": "posterior = likelihood * belief"}),
        Mistake("the likelihood is added, and not multiplied", {"likelihood * moved": "likelihood + moved"}),
        Mistake(
            "only the most probable way into a cell counts, where all of them should be added",
            {"moved[k] += motion[k, i] * belief[i]": "moved[k] = max(moved[k], motion[k, i] * belief[i])"},
        ),
        Mistake(
            "only the last way into a cell counts: = stands where += should",
            {"moved[k] += motion": "moved[k] = motion"},
        ),
        Mistake(
            "probabilities are divided by the largest, and not by their sum", {"posterior.sum()": "posterior.max()"}
        ),
        Mistake(
            "the old belief is multiplied in once more",
            {"posterior = likelihood * moved": "posterior = likelihood * moved * belief"},
        ),
        Mistake("the loop misses the last cell", {"for i in range(n)": "for i in range(n - 1)"}),
        Mistake("the loop misses the first cell", {"for i in range(n)": "for i in range(1, n)"}),
        Mistake("the likelihood is divided by, and not multiplied", {"likelihood * moved": "moved / likelihood"}),
        Mistake("the indices of the old belief are off by one", {"belief[i]": "belief[i - 1]"}),
        Mistake("the indices of the result are off by one", {"moved[k] +=": "moved[k - 1] +="}),
    ),
)
