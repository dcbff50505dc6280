"""Lesson ess: the effective sample size, by which one decides when to resample."""

from __future__ import annotations

import numpy as np

from pipeline.lessons.exam import Array, Case, Exact, Returned
from pipeline.lessons.lesson import Lesson, Mistake


def effective_sample_size(log_weights: Array) -> float:
    """How many particles of equal weight would say as much as these (Kong, Liu and Wong 1994).

    log_weights: (n,) float64, natural logarithms of the particles' weights, which need not sum to one: a constant
        added to all of them changes nothing. They may be far below the logarithm of the smallest number that a
        computer holds, for they are sums over many beams.
    Returns a float from 1 to n: one over the sum of the squares of the weights, where the weights sum to one.
    """
    weights = np.exp(log_weights - log_weights.max())
    weights = weights / weights.sum()
    return float(1.0 / np.sum(weights**2))


def _cases() -> list[Case]:
    rng = np.random.default_rng(44)
    some = np.log(rng.uniform(0.1, 1.0, 50))
    return [
        Case("equal weights", (np.full(20, -np.log(20.0)),)),
        Case("weights that sum to one", (np.log(np.array([0.5, 0.25, 0.125, 0.125])),)),
        Case("weights that sum to one", (some - np.log(np.exp(some).sum()),)),
        Case("weights that do not sum to one", (np.log(np.array([3.0, 1.0, 0.5, 0.25, 0.25])),)),
        Case("weights that do not sum to one", (some,)),
        Case("one particle", (np.array([-3.0]),)),
        Case("a single heavy particle", (np.array([0.0, -20.0, -20.0, -30.0, -25.0]),)),
        Case("a particle without any weight", (np.array([-1.0, -np.inf, -1.0, -1.5]),)),
        Case("logarithms far below 0, as many beams make them", (-2000.0 + rng.normal(0.0, 1.5, 40),)),
        Case("logarithms far below 0, as many beams make them", (-900.0 + rng.normal(0.0, 0.5, 300),)),
    ]


LESSON = Lesson(
    name="ess",
    title="The effective sample size: when to resample",
    source="Probabilistic Robotics, Section 4.3, on when to resample; Kong, Liu and Wong 1994",
    task=(
        "Who resamples at every scan loses particles that were right, by bad luck; who never does is left with one "
        "particle that counts. So one resamples when the weights have become uneven, mostly when the effective "
        "sample size falls below half the number of particles. The weights come as logarithms, for the likelihood "
        "of a scan is a product of many small numbers: exp(-2000) is 0 to a computer."
    ),
    reference=effective_sample_size,
    exam=Exact(effective_sample_size, [Returned("the effective sample size", "particles")], _cases()),
    mistakes=(
        Mistake(
            "exp() of the logarithms is taken as they are, which is 0 for all particles if they are far below 0",
            {"log_weights - log_weights.max()": "log_weights"},
        ),
        Mistake("the weights are not normalised", {"weights / weights.sum()": "weights"}),
        Mistake(
            "neither the largest logarithm is subtracted nor are the weights normalised",
            {"log_weights - log_weights.max()": "log_weights", "weights / weights.sum()": "weights"},
        ),
        Mistake("the weights are not squared", {"weights**2": "weights"}),
        Mistake(
            "the sum of the squares is returned, and not one over it",
            {"1.0 / np.sum(weights**2)": "np.sum(weights**2)"},
        ),
        Mistake(
            "the square root of the sum of the squares is taken",
            {"1.0 / np.sum(weights**2)": "1.0 / np.sqrt(np.sum(weights**2))"},
        ),
        Mistake(
            "the logarithms are taken for the weights themselves",
            {"np.exp(log_weights - log_weights.max())": "log_weights"},
        ),
        Mistake(
            "the logarithms are taken for those to the base of ten",
            {"np.exp(log_weights - log_weights.max())": "10 ** (log_weights - log_weights.max())"},
        ),
        Mistake(
            "the entropy is used: its exponential is another measure",
            {"1.0 / np.sum(weights**2)": "np.exp(-np.nansum(weights * np.log(weights)))"},
        ),
        Mistake(
            "the share of the particles is returned, and not their number",
            {"1.0 / np.sum(weights**2)": "1.0 / np.sum(weights**2) / len(weights)"},
        ),
        Mistake("the weight of the heaviest particle is used", {"1.0 / np.sum(weights**2)": "1.0 / weights.max()"}),
        Mistake("only the last weight counts: = stands where += should", {"np.sum(weights**2)": "weights[-1] ** 2"}),
        Mistake(
            "the smallest logarithm is subtracted, and not the largest", {"log_weights.max()": "log_weights.min()"}
        ),
        Mistake(
            "the difference to the largest logarithm is the wrong way round",
            {"log_weights - log_weights.max()": "log_weights.max() - log_weights"},
        ),
    ),
)
