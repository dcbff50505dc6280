"""Lesson 8.3: how augmented MCL tells that the robot is lost."""

from __future__ import annotations

from pipeline.lessons.exam import Case, Exact, Returned
from pipeline.lessons.lesson import Lesson, Mistake


def random_share(
    w_avg: float, w_slow: float, w_fast: float, alpha_slow: float, alpha_fast: float
) -> tuple[float, float, float]:
    """Follow the likelihood by two averages, and say how many particles shall be random (Probabilistic Robotics, Table
    8.3, lines 8 to 13).

    w_avg: the mean of the particles' likelihoods at this scan, before they are normalised.
    w_slow, w_fast: the two averages so far. Both are 0 before the first scan.
    alpha_slow, alpha_fast: the rates at which they follow, from 0 to 1, the slow one the smaller.
    Returns w_slow and w_fast after this scan, and the probability with which a particle is a random one: 0 where
        the fast average is above the slow one.
    """
    w_slow = w_slow + alpha_slow * (w_avg - w_slow)
    w_fast = w_fast + alpha_fast * (w_avg - w_fast)
    return w_slow, w_fast, max(0.0, 1.0 - w_fast / w_slow)


def _cases() -> list[Case]:
    rates = (0.02, 0.3)
    rows: list[tuple[str, tuple[float, ...]]] = [
        ("the first scan, when both averages are 0", (0.4, 0.0, 0.0, *rates)),
        ("the scans fit as before", (0.5, 0.5, 0.5, *rates)),
        ("the scans fit better than before", (0.9, 0.4, 0.6, *rates)),
        ("the scans fit worse than before", (0.01, 0.5, 0.5, *rates)),
        ("the scans fit worse than before", (0.05, 0.48, 0.2, *rates)),
        ("the scans fit worse than before", (0.2, 0.6, 0.45, 0.1, 0.5)),
        ("likelihoods are small, as of many beams", (3e-9, 8e-8, 5e-8, *rates)),
        ("likelihoods are large, as of a sharp density", (40.0, 900.0, 300.0, *rates)),
        ("the averages come apart slowly", (0.3, 0.5, 0.42, 0.001, 0.1)),
    ]
    return [Case(group, tuple(map(float, values))) for group, values in rows]


LESSON = Lesson(
    name="8.3",
    title="Augmented MCL: when to draw random particles",
    source="Probabilistic Robotics, Section 8.3 and Table 8.3",
    task=(
        "A robot that was carried off is not found again by particles that are all elsewhere. So some particles are "
        "drawn at random, and more of them the worse the scans fit. How badly they fit is told by two averages of "
        "the likelihood: where the one that follows quickly is below the one that follows slowly, the scans have "
        "begun to fit worse."
    ),
    reference=random_share,
    exam=Exact(
        random_share,
        [Returned("w_slow"), Returned("w_fast"), Returned("the share of random particles")],
        _cases(),
        least=1e-12,
    ),
    mistakes=(
        Mistake(
            "the share of random particles is not kept from falling below 0",
            {"max(0.0, 1.0 - w_fast / w_slow)": "1.0 - w_fast / w_slow"},
        ),
        Mistake("slow and fast are exchanged in the quotient", {"w_fast / w_slow)": "w_slow / w_fast)"}),
        Mistake(
            "the rates are exchanged",
            {
                "w_slow + alpha_slow * (w_avg": "w_slow + alpha_fast * (w_avg",
                "w_fast + alpha_fast * (w_avg": "w_fast + alpha_slow * (w_avg",
            },
        ),
        Mistake(
            "the averages go away from the likelihood: the difference is the wrong way round",
            {
                "alpha_slow * (w_avg - w_slow)": "alpha_slow * (w_slow - w_avg)",
                "alpha_fast * (w_avg - w_fast)": "alpha_fast * (w_fast - w_avg)",
            },
        ),
        Mistake(
            "the averages before this scan are used for the share",
            {
                "w_slow = w_slow + alpha_slow": (
                    "share = max(0.0, 1.0 - w_fast / max(w_slow, 1e-300))\n    w_slow = w_slow + alpha_slow"
                ),
                "return w_slow, w_fast, max(0.0, 1.0 - w_fast / w_slow)": "return w_slow, w_fast, share",
            },
        ),
        Mistake(
            "the averages are sums: what they were is not taken off",
            {
                "alpha_slow * (w_avg - w_slow)": "alpha_slow * w_avg",
                "alpha_fast * (w_avg - w_fast)": "alpha_fast * w_avg",
            },
        ),
        Mistake(
            "the averages are replaced, not moved, by the weighted difference",
            {
                "w_slow = w_slow + alpha_slow": "w_slow = alpha_slow",
                "w_fast = w_fast + alpha_fast": "w_fast = alpha_fast",
            },
        ),
        Mistake(
            "the quotient is returned, and not one minus it",
            {"max(0.0, 1.0 - w_fast / w_slow)": "max(0.0, w_fast / w_slow)"},
        ),
        Mistake(
            "the rates count for what is kept, and not for what is new",
            {
                "w_slow + alpha_slow * (w_avg - w_slow)": "w_avg + alpha_slow * (w_slow - w_avg)",
                "w_fast + alpha_fast * (w_avg - w_fast)": "w_avg + alpha_fast * (w_fast - w_avg)",
            },
        ),
        Mistake(
            "the likelihood of this scan is compared with the slow average, where the fast average should be",
            {"w_fast / w_slow)": "w_avg / w_slow)"},
        ),
        Mistake("min stands where max should", {"max(0.0, 1.0 - w_fast / w_slow)": "min(0.0, 1.0 - w_fast / w_slow)"}),
        Mistake(
            "the difference of the averages is taken, and not their quotient",
            {"1.0 - w_fast / w_slow": "w_slow - w_fast"},
        ),
        Mistake(
            "w_fast and w_slow are returned in the wrong order",
            {"return w_slow, w_fast, max": "return w_fast, w_slow, max"},
        ),
    ),
)
