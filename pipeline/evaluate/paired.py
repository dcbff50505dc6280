"""Two variants seed by seed: the same logs and the same seeds, so that what differs is the variant.

Which of the two succeeds is tested by McNemar's test in its exact form, the sign test on the seeds with which only one
of them does; shares and errors by Wilcoxon's signed-rank test on the differences (Wilcoxon 1945; two-sided both). Seeds
are drawn by us, so a small p tells of this log only, and of several variants each is tested by itself, uncorrected.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pipeline.evaluate.aftermath import Row
from pipeline.evaluate.metrics import Score

if TYPE_CHECKING:
    from pipeline.evaluate.report import LogEvaluation

PAIRED_COLUMNS = ("log", "only this", "only first", "p", "right (%)", "p", "error (m)", "p")
"""Headings of ``paired_row``: with how many seeds only this variant succeeds, and only the first one; the median, over
seeds, by how much more scans are right, and by how much larger the error since found is; and the p of each."""


@dataclass(frozen=True)
class Difference:
    """What a variant has more than the first one: ``median`` over the ``pairs`` of runs that both have it, and ``p`` of
    Wilcoxon's signed-rank test; None where there are no pairs."""

    pairs: int
    median: float | None
    p: float | None


@dataclass(frozen=True)
class Paired:
    """A ``variant`` against the first one on one ``log``, seed by seed.

    ``only_this``, ``only_first``: with how many seeds only one of the two succeeds; ``p_success``: of McNemar's exact
    test. ``right``: share of all scans right, 0 to 1; ``error``: the run's median position error since found, m.
    """

    log: str
    variant: str
    seeds: int
    only_this: int
    only_first: int
    p_success: float
    right: Difference
    error: Difference


def paired(first: LogEvaluation, this: LogEvaluation, variant: str) -> Paired:
    """Two evaluations of one log with the same seeds, in the same order."""
    success = np.array([[run.success for run in log.runs] for log in (first, this)])
    only_this, only_first = (int(np.sum(one & ~other)) for one, other in (success[::-1], success))
    return Paired(
        log=first.name,
        variant=variant,
        seeds=len(first.runs),
        only_this=only_this,
        only_first=only_first,
        p_success=sign_test(only_this, only_first),
        right=_difference(first, this, lambda score: score.scans_right),
        error=_difference(first, this, lambda score: score.position_error.median if score.position_error else None),
    )


def sign_test(more: int, less: int) -> float:
    """Two-sided p of so uneven a split of more + less fair coins, 1 without any; of discordant pairs, McNemar's."""
    from scipy.stats import binomtest

    return float(binomtest(more, more + less, 0.5).pvalue) if more + less else 1.0


def signed_rank_test(differences: Sequence[float]) -> float:
    """Two-sided p of Wilcoxon's signed-rank test, zeros left out; 1 where all are zero."""
    from scipy.stats import wilcoxon

    nonzero = [difference for difference in differences if difference != 0.0]
    return float(wilcoxon(nonzero).pvalue) if nonzero else 1.0


def paired_row(one: Paired) -> Row:
    """A row of strings under PAIRED_COLUMNS, with the variant after the log."""
    differences = []
    for difference, form, unit in ((one.right, "+.1f", 100.0), (one.error, "+.3f", 1.0)):
        if difference.median is None or difference.p is None:
            differences += ["-", "-"]
        else:
            differences += [format(unit * difference.median, form), p_value(difference.p)]
    counts = (str(one.only_this), str(one.only_first), p_value(one.p_success))
    return (one.log, one.variant, *counts, *differences)


def p_value(p: float) -> str:
    """As it is printed."""
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def _difference(first: LogEvaluation, this: LogEvaluation, value: Callable[[Score], float | None]) -> Difference:
    pairs = [
        (a, b)
        for one, other in zip(first.runs, this.runs, strict=True)
        if one.score is not None and other.score is not None
        if (a := value(one.score)) is not None and (b := value(other.score)) is not None
    ]
    if not pairs:
        return Difference(0, None, None)
    differences = [b - a for a, b in pairs]
    return Difference(len(pairs), float(np.median(differences)), signed_rank_test(differences))
