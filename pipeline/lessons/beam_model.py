"""Lesson 6.1: the beam model of a range finder."""

from __future__ import annotations

import math

import numpy as np

from pipeline.lessons.exam import Array, Case, Exact, Returned
from pipeline.lessons.lesson import Lesson, Mistake

_erf = np.vectorize(math.erf, otypes=[np.float64])


def beam_range_finder_model(
    z: Array,
    z_star: Array,
    z_hit: float,
    z_short: float,
    z_max: float,
    z_rand: float,
    sigma_hit: float,
    lambda_short: float,
    max_range: float,
) -> Array:
    """Likelihood of each beam, given the range that the map has (Probabilistic Robotics, Table 6.1).

    z: (k,) float64, measured ranges, m, from 0 to max_range; exactly max_range means that nothing came back.
    z_star: (k,) float64, true ranges from the map, m, above 0.
    z_hit, z_short, z_max, z_rand: the weights of the four parts.
    sigma_hit: standard deviation of a hit, m. lambda_short: rate of unexpected obstacles, 1/m.
    max_range: the laser's longest range, m.
    Returns (k,): the weighted sum of p_hit, p_short, p_max and p_rand for each beam, per metre. p_hit is a normal
        density about z_star, normalised over 0 to max_range; p_short is an exponential one, normalised over
        0 to z_star and zero behind it; p_max is 1 if z is max_range, else 0; p_rand is uniform over 0 to
        max_range, and zero if z is max_range.
    """
    spread = math.sqrt(2.0) * sigma_hit
    inside = 0.5 * (_erf((max_range - z_star) / spread) - _erf((0.0 - z_star) / spread))
    p_hit = np.exp(-0.5 * ((z - z_star) / sigma_hit) ** 2) / (math.sqrt(2.0 * math.pi) * sigma_hit) / inside
    p_short = lambda_short * np.exp(-lambda_short * z) / (1.0 - np.exp(-lambda_short * z_star))
    p_short = np.where(z <= z_star, p_short, 0.0)
    p_max = np.where(z == max_range, 1.0, 0.0)
    p_rand = np.where(z < max_range, 1.0 / max_range, 0.0)
    return np.asarray(z_hit * p_hit + z_short * p_short + z_max * p_max + z_rand * p_rand)


_WEIGHTS = (0.6, 0.25, 0.05, 0.1)


def _case(group: str, pairs: list[tuple[float, float]], *, sigma: float = 0.25, rate: float = 0.4) -> Case:
    """Pairs of measured and true range, by a laser that sees 12 m."""
    z, z_star = np.array(pairs).T
    rows = tuple(f"p for z = {a:g} m, z* = {b:g} m" for a, b in pairs)
    return Case(group, (z.copy(), z_star.copy(), *_WEIGHTS, sigma, rate, 12.0), rows)


LESSON = Lesson(
    name="6.1",
    title="The beam model of a range finder",
    source="Probabilistic Robotics, Section 6.3 and Table 6.1",
    task=(
        "A beam may hit the wall that the map has, give or take some noise; somebody may stand in its way; nothing "
        "may come back; or it may be anything. The likelihood of a reading is the weighted sum of these four. Two "
        "of them are cut off, and have to be normalised over what is left. The integral of a normal density is told "
        "by the error function: math.erf takes single numbers, scipy.special.erf arrays."
    ),
    reference=beam_range_finder_model,
    exam=Exact(
        beam_range_finder_model,
        [Returned("p", "per metre")],
        [
            _case("hits", [(4.0, 4.0), (4.3, 4.0), (3.8, 4.0), (8.1, 8.0), (1.75, 2.0), (6.4, 6.0)]),
            _case("a wall so near that p_hit is cut off at 0", [(0.1, 0.2), (0.3, 0.2), (0.25, 0.1), (0.02, 0.3)]),
            _case(
                "a wall at the end of the range, where p_hit is cut off", [(11.9, 11.9), (11.7, 11.95), (11.95, 11.8)]
            ),
            _case("something stands before the wall", [(0.5, 5.0), (2.0, 5.0), (3.0, 9.0), (1.0, 1.9), (0.0, 3.0)]),
            _case("z is exactly z*", [(0.5, 0.5), (2.0, 2.0), (7.5, 7.5)], sigma=0.5, rate=1.5),
            _case("behind the wall", [(6.5, 5.0), (11.0, 3.0), (3.2, 2.0), (2.0, 0.5)]),
            _case("nothing came back", [(12.0, 3.0), (12.0, 8.0), (12.0, 10.5)]),
        ],
    ),
    mistakes=(
        Mistake("p_hit is not normalised over 0 to max_range", {" / inside": ""}),
        Mistake("p_hit is multiplied by its integral, and not divided by it", {" / inside": " * inside"}),
        Mistake("p_short is not normalised over 0 to z*", {" / (1.0 - np.exp(-lambda_short * z_star))": ""}),
        Mistake("p_short is not cut off at z*", {"np.where(z <= z_star, p_short, 0.0)": "p_short"}),
        Mistake("p_short counts behind z*, and not before it", {"np.where(z <= z_star": "np.where(z >= z_star"}),
        Mistake("p_short leaves out z = z*", {"np.where(z <= z_star": "np.where(z < z_star"}),
        Mistake(
            "p_short lacks its factor lambda_short",
            {"lambda_short * np.exp(-lambda_short * z)": "np.exp(-lambda_short * z)"},
        ),
        Mistake(
            "lambda_short is taken for a mean distance, and not for a rate",
            {
                "lambda_short * np.exp(-lambda_short * z)": "np.exp(-z / lambda_short) / lambda_short",
                "np.exp(-lambda_short * z_star)": "np.exp(-z_star / lambda_short)",
            },
        ),
        Mistake(
            "p_short is normalised over 0 to z, and not to z*",
            {"1.0 - np.exp(-lambda_short * z_star)": "1.0 - np.exp(-lambda_short * z)"},
        ),
        Mistake("p_max is left out: what came back from nowhere has no likelihood", {" + z_max * p_max": ""}),
        Mistake(
            "p_rand counts where nothing came back",
            {"np.where(z < max_range, 1.0 / max_range, 0.0)": "1.0 / max_range"},
        ),
        Mistake("p_rand is left out", {" + z_rand * p_rand": ""}),
        Mistake("p_rand is not divided by max_range", {"z < max_range, 1.0 / max_range": "z < max_range, 1.0"}),
        Mistake(
            "sigma_hit is taken for a variance",
            {
                "math.sqrt(2.0) * sigma_hit": "math.sqrt(2.0 * sigma_hit)",
                "((z - z_star) / sigma_hit) ** 2": "(z - z_star) ** 2 / sigma_hit",
                "(math.sqrt(2.0 * math.pi) * sigma_hit)": "math.sqrt(2.0 * math.pi * sigma_hit)",
            },
        ),
        Mistake(
            "the normal density lacks its factor 1 / (sqrt(2 pi) sigma_hit)",
            {" / (math.sqrt(2.0 * math.pi) * sigma_hit)": ""},
        ),
        Mistake("the factor one half is missing in the exponent", {"np.exp(-0.5 * ((z": "np.exp(-1.0 * ((z"}),
        Mistake(
            "two pi stands outside the square root",
            {"math.sqrt(2.0 * math.pi) * sigma_hit": "2.0 * math.pi * sigma_hit"},
        ),
        Mistake(
            "the error function is taken without the square root of two", {"math.sqrt(2.0) * sigma_hit": "sigma_hit"}
        ),
        Mistake(
            "the error function is taken for the share below a value", {"0.5 * (_erf((max_range": "(_erf((max_range"}
        ),
        Mistake("measured and true range are exchanged", {"spread = math": "z, z_star = z_star, z\n    spread = math"}),
        Mistake(
            "the weights of p_hit and p_short are exchanged",
            {"z_hit * p_hit + z_short * p_short": "z_short * p_hit + z_hit * p_short"},
        ),
        Mistake(
            "the weights of p_max and p_rand are exchanged",
            {"z_max * p_max + z_rand * p_rand": "z_rand * p_max + z_max * p_rand"},
        ),
        Mistake(
            "the logarithm of the likelihood is returned",
            {"np.asarray(z_hit": "np.log(z_hit"},
        ),
        Mistake("the exponent of p_hit has the wrong sign", {"np.exp(-0.5 * ((z": "np.exp(0.5 * ((z"}),
        Mistake(
            "the difference of the ranges is not squared in p_hit",
            {"((z - z_star) / sigma_hit) ** 2": "((z - z_star) / sigma_hit)"},
        ),
        Mistake(
            "the square root of two pi is not taken",
            {"(math.sqrt(2.0 * math.pi) * sigma_hit)": "(2.0 * math.pi * sigma_hit**2)"},
        ),
        Mistake(
            "the exponent of p_short has the wrong sign", {"np.exp(-lambda_short * z)": "np.exp(lambda_short * z)"}
        ),
        Mistake(
            "p_short is multiplied by its integral, and not divided by it", {" / (1.0 - np.exp(": " * (1.0 - np.exp("}
        ),
        Mistake(
            "1 + exp stands in the integral of p_short, where 1 - exp should", {"(1.0 - np.exp(": "(1.0 + np.exp("}
        ),
        Mistake(
            "the integral of p_hit is the sum of two values of the error function, where it should be their difference",
            {"spread) - _erf(": "spread) + _erf("},
        ),
        Mistake("p_max counts everywhere but where nothing came back", {"z == max_range": "z != max_range"}),
        Mistake("p_short is subtracted", {"+ z_short * p_short": "- z_short * p_short"}),
        Mistake("p_max is subtracted", {"+ z_max * p_max": "- z_max * p_max"}),
        Mistake("p_rand is subtracted", {"+ z_rand * p_rand": "- z_rand * p_rand"}),
        Mistake(
            "p_rand is multiplied by max_range, and not divided by it",
            {"z < max_range, 1.0 / max_range": "z < max_range, max_range"},
        ),
    ),
)
