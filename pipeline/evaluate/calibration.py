"""Whether a run knows how much it knows: stated probabilities and covariances, held against the truth.

At every scan a run states a probability that its pose is right, that is, within 0.5 m and 10 degrees. Of the scans at
which it states 0.8, four of five should be. Brier's score is the mean of (p - right)^2, the log score the mean of
-ln p of what came out; both are told beside the base rate's, of a forecaster who always states the share of all scans
that were right. Covariances are held against the errors by the shares inside their regions, and by NEES (Bar-Shalom,
Li and Kirubarajan 2001, Section 5.4). Scans of a run err together, so intervals come from drawing whole runs anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.special import chdtri

from pipeline.evaluate.aftermath import Row
from pipeline.evaluate.metrics import Array, is_localized, known, pose_errors
from pipeline.geometry import wrap_angle

if TYPE_CHECKING:
    from pipeline.evaluate.report import Run
    from pipeline.localization import RunResult

BINS: Final = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0])
"""Borders of the bins of stated probability; the last bin has its upper border."""
CLIP: Final = (0.001, 0.999)
"""Probabilities are taken to be no farther out: nobody is sure, and a logarithm has no place for who is."""
REGIONS: Final = (0.5, 0.9, 0.95)
DRAWS: Final = 1000
"""How often the runs are drawn anew for an interval."""
LEAST: Final = np.array([1e-3, 1e-3, 1e-4])
"""m, m, rad: nobody's standard deviation is taken to be less, which keeps covariances of a single pose invertible."""

RELIABILITY_COLUMNS = ("log", "stated", "scans", "mean stated", "right", "95 % CI")
"""Headings of ``reliability_table``."""
SCORE_COLUMNS = ("log", "score", "of the run", "95 % CI", "of the base rate", "95 % CI")
"""Headings of ``score_table``."""
REGION_COLUMNS = ("log", "", "of all scans", "95 % CI", "of right scans", "95 % CI")
"""Headings of ``region_table``."""


def stated_probability(result: RunResult) -> Array:
    """(n,): with what probability a run says, scan by scan, that its pose is right: its verdict's probability."""
    return result.probability


@dataclass(frozen=True)
class Figure:
    """A number and its 95 % interval over runs; None where there is nothing to count, or only one run."""

    value: float | None
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Bin:
    """Scans at which ``low`` <= stated < ``high``: the mean of what was stated, and the share that was right."""

    low: float
    high: float
    scans: int
    stated: float | None
    right: Figure


@dataclass(frozen=True)
class Region:
    """Shares of the scans, of all and of those that are right, whose truth lies inside a region of the belief.

    ``name``: "position" (2 degrees of freedom) or "heading" (1); ``probability``: that the region should have.
    """

    name: str
    probability: float
    all: Figure
    right: Figure


@dataclass(frozen=True)
class Calibration:
    """How well probabilities and covariances of some runs are calibrated, over all their scans with a known truth.

    ``brier``, ``log_score``: of what was stated; ``base_*``: of the base rate. ``nees``: the mean of e^T P^-1 e / 3
    over the scans that are right, 1 if errors are as large as the covariances say.
    """

    runs: int
    scans: int
    base_rate: Figure
    bins: tuple[Bin, ...]
    brier: Figure
    base_brier: Figure
    log_score: Figure
    base_log_score: Figure
    regions: tuple[Region, ...]
    nees: Figure

    def to_dict(self) -> dict[str, Any]:
        """As plain values, ready for JSON."""
        return asdict(self)


def calibration(runs: Sequence[Run], seed: int = 0) -> Calibration:
    """Calibration of the runs, of one log or of several; ``seed`` draws the runs for the intervals."""
    counted = np.array([_counts(run) for run in runs])
    sample = np.random.default_rng(seed).multinomial(len(runs), np.full(len(runs), 1.0 / len(runs)), size=DRAWS)
    drawn = sample @ counted if len(runs) > 1 else np.zeros((0, counted.shape[1]))
    sums = Sums(np.vstack([counted.sum(axis=0)[None], drawn]))
    rate = sums.share("right", "scans")
    bins = tuple(
        Bin(float(BINS[k]), float(BINS[k + 1]), int(sums["scans in", k][0]), _first(sums.share(("stated in", k), n)),
            _figure(sums.share(("right in", k), n)))
        for k in range(len(BINS) - 1)
        for n in [("scans in", k)]
    )  # fmt: skip
    clipped = np.clip(rate, *CLIP)
    regions = tuple(
        Region(name, each, _figure(sums.share((name, k), "scans")), _figure(sums.share((f"{name} right", k), "right")))
        for name in ("position", "heading")
        for k, each in enumerate(REGIONS)
    )
    return Calibration(
        runs=len(runs),
        scans=int(sums["scans"][0]),
        base_rate=_figure(rate),
        bins=bins,
        brier=_figure(sums.share("brier", "scans")),
        base_brier=_figure(rate * (1.0 - rate)),
        log_score=_figure(sums.share("log", "scans")),
        base_log_score=_figure(-rate * np.log(clipped) - (1.0 - rate) * np.log(1.0 - clipped)),
        regions=regions,
        nees=_figure(sums.share("nees", "right")),
    )


# --- counting -----------------------------------------------------------------------------------------------------

Name = str | tuple[str, int]
_NAMES: Final[tuple[Name, ...]] = (
    "scans", "right", "brier", "log", "nees",
    *((name, k) for name in ("scans in", "stated in", "right in") for k in range(len(BINS) - 1)),
    *((name, k) for name in ("position", "position right", "heading", "heading right") for k in range(len(REGIONS))),
)  # fmt: skip
"""What is counted of a run, and added up over runs: everything else is a ratio of two of these."""


@dataclass(frozen=True)
class Sums:
    """(draws + 1, names): sums over the runs as they are, then over those of each draw."""

    table: Array

    def __getitem__(self, name: Name) -> Array:
        """One of the sums, (draws + 1,)."""
        return self.table[:, _NAMES.index(name)]

    def share(self, name: Name, of: Name) -> Array:
        """A ratio of two, NaN where there is nothing to divide by."""
        total = self[of]
        return np.divide(self[name], total, out=np.full(len(total), np.nan), where=total > 0)


def _counts(run: Run) -> Array:
    """One run's part of all sums, in the order of _NAMES."""
    scored = known(run.truth)
    poses, truth, covariances = run.poses[scored], run.truth[scored], run.covariances[scored]
    right = is_localized(*pose_errors(poses, truth))
    stated = np.clip(run.probability[scored], *CLIP)
    which = np.clip(np.searchsorted(BINS, run.probability[scored], side="right") - 1, 0, len(BINS) - 2)
    in_bin = which == np.arange(len(BINS) - 1)[:, None]
    off = np.column_stack([poses[:, :2] - truth[:, :2], wrap_angle(poses[:, 2] - truth[:, 2])])
    covariances = covariances + np.diag(LEAST**2)
    position, heading = _squared(off[:, :2], covariances[:, :2, :2]), off[:, 2] ** 2 / covariances[:, 2, 2]
    inside = [
        (distance <= chdtri(freedom, 1.0 - np.array(REGIONS))[:, None])
        for distance, freedom in ((position, 2), (heading, 1))
    ]
    sums = [
        np.sum(scored),
        np.sum(right),
        np.sum((stated - right) ** 2),
        -np.sum(np.log(np.where(right, stated, 1.0 - stated))),
        np.sum(_squared(off, covariances)[right]) / 3.0,
    ]
    each = [
        in_bin.sum(axis=1),
        (in_bin * run.probability[scored]).sum(axis=1),
        (in_bin & right).sum(axis=1),
        *(counts for hits in inside for counts in (hits.sum(axis=1), (hits & right).sum(axis=1))),
    ]
    return np.concatenate([np.array(sums, np.float64), *(counts.astype(np.float64) for counts in each)])


def _squared(off: Array, covariances: Array) -> Array:
    """e^T P^-1 e, (n,), of errors (n, d) with covariances (n, d, d)."""
    return np.einsum("ij,ij->i", off, np.linalg.solve(covariances, off[..., None])[..., 0])


def _first(values: Array) -> float | None:
    return None if np.isnan(values[0]) else float(values[0])


def _figure(values: Array) -> Figure:
    """The first of the values, and the 2.5th and 97.5th percentile of those drawn that there are."""
    drawn = values[1:][~np.isnan(values[1:])]
    if np.isnan(values[0]) or not len(drawn):
        return Figure(_first(values), None, None)
    low, high = np.percentile(drawn, [2.5, 97.5])
    return Figure(float(values[0]), float(low), float(high))


# --- tables -------------------------------------------------------------------------------------------------------


def reliability_table(name: str, told: Calibration) -> list[Row]:
    """One row of strings for each bin that has scans, under RELIABILITY_COLUMNS."""
    return [
        (name, f"{each.low:g}-{each.high:g}", f"{each.scans:,}", _number(each.stated), *_told(each.right))
        for each in told.bins
        if each.scans
    ]


def score_table(name: str, told: Calibration) -> list[Row]:
    """Brier's score and the log score as rows of strings, under SCORE_COLUMNS."""
    return [
        (name, "Brier", *_told(told.brier), *_told(told.base_brier)),
        (name, "log", *_told(told.log_score), *_told(told.base_log_score)),
    ]


def region_table(name: str, told: Calibration) -> list[Row]:
    """Shares inside the regions and NEES as rows of strings, under REGION_COLUMNS."""
    regions = [
        (name, f"{each.name} inside {100 * each.probability:g} %", *_told(each.all), *_told(each.right))
        for each in told.regions
    ]
    return [*regions, (name, "NEES", "-", "-", *_told(told.nees))]


def _told(figure: Figure) -> Row:
    interval = "-" if figure.low is None or figure.high is None else f"{figure.low:.3f}-{figure.high:.3f}"
    return (_number(figure.value), interval)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
