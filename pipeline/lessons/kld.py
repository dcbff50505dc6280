"""Lesson 8.4: how many particles KLD-sampling draws."""

from __future__ import annotations

import numpy as np

from pipeline.lessons.exam import Case, Exact, Returned
from pipeline.lessons.lesson import Lesson, Mistake


def kld_particles(bins: int, epsilon: float, quantile: float) -> float:
    """How many particles keep the error of a belief small (Probabilistic Robotics, Table 8.4, and Fox 2003).

    bins: in how many bins of a grid over the poses there are particles, 1 or more.
    epsilon: the largest Kullback-Leibler distance between the belief and the particles.
    quantile: z, the upper quantile of the standard normal distribution for the probability with which the distance
        may be larger: 2.33 for one in a hundred.
    Returns a float: the number of particles, rounded up or not; 1 for a single bin.
    """
    if bins <= 1:
        return 1.0
    a = 2.0 / (9.0 * (bins - 1))
    return float((bins - 1) / (2.0 * epsilon) * (1.0 - a + np.sqrt(a) * quantile) ** 3)


def _cases() -> list[Case]:
    asked = {
        "a single bin": [(1, 0.001, 2.33)],
        "few bins": [(2, 0.001, 2.33), (3, 0.0005, 2.33), (6, 0.001, 1.28)],
        "many bins": [(40, 0.002, 2.33), (300, 0.005, 2.33), (2500, 0.02, 2.33)],
        "other probabilities": [(30, 0.002, 0.0), (30, 0.002, 3.09), (30, 0.002, -1.0)],
    }
    return [Case(group, each, (_row(*each),)) for group, rows in asked.items() for each in rows]


def _row(bins: int, epsilon: float, quantile: float) -> str:
    return f"particles for {bins} {'bin' if bins == 1 else 'bins'}, epsilon {epsilon:g}, z {quantile:g}"


LESSON = Lesson(
    name="8.4",
    title="KLD-sampling: how many particles",
    source="Probabilistic Robotics, Section 8.3 and Table 8.4; Fox 2003",
    task=(
        "A belief that is spread over a building needs many particles, one that sits in one place needs few. "
        "KLD-sampling counts in how many bins of a grid there are particles, and draws until there are enough for "
        "so many bins: the chi-square distribution says how many, by Wilson and Hilferty's approximation. Mind that "
        "bins - 1 stands in the formula three times, and that the approximation is a third power."
    ),
    reference=kld_particles,
    exam=Exact(kld_particles, [Returned("particles", "particles")], _cases(), least=0.998),
    mistakes=(
        Mistake(
            "the number of bins is taken, and not one less",
            {"(9.0 * (bins - 1))": "(9.0 * bins)", "(bins - 1) / (2.0 * epsilon)": "bins / (2.0 * epsilon)"},
        ),
        Mistake(
            "one is not taken off the number of bins in the first factor",
            {"(bins - 1) / (2.0 * epsilon)": "bins / (2.0 * epsilon)"},
        ),
        Mistake(
            "one is not taken off the number of bins within the third power", {"(9.0 * (bins - 1))": "(9.0 * bins)"}
        ),
        Mistake("the third power is missing", {" ** 3)": ")"}),
        Mistake("the second power is taken, and not the third", {" ** 3)": " ** 2)"}),
        Mistake("the square root before z is missing", {"np.sqrt(a) * quantile": "a * quantile"}),
        Mistake("z is subtracted, and not added", {"+ np.sqrt(a) * quantile": "- np.sqrt(a) * quantile"}),
        Mistake(
            "2/9 is divided by its bins the wrong way round", {"2.0 / (9.0 * (bins - 1))": "2.0 * (bins - 1) / 9.0"}
        ),
        Mistake(
            "2 epsilon stands outside the quotient, so that it is multiplied",
            {"(bins - 1) / (2.0 * epsilon)": "(bins - 1) / 2.0 * epsilon"},
        ),
        Mistake("the factor 2 before epsilon is missing", {"(2.0 * epsilon)": "epsilon"}),
        Mistake("2/9 is added, and not subtracted", {"1.0 - a +": "1.0 + a +"}),
        Mistake("a single bin needs no particle", {"        return 1.0": "        return -1.0"}),
        Mistake(
            "the probability is not turned into a quantile, but used itself: z is given already",
            {"np.sqrt(a) * quantile": "np.sqrt(a) * 0.01"},
        ),
        Mistake("the sign of 1 - 2/9... is the wrong way round", {"1.0 - a +": "a - 1.0 +"}),
        Mistake(
            "one is added to the number of bins, and not taken off",
            {"(9.0 * (bins - 1))": "(9.0 * (bins + 1))", "(bins - 1) / (2.0": "(bins + 1) / (2.0"},
        ),
        Mistake("three times stands where the third power should", {" ** 3)": " * 3)"}),
    ),
)
