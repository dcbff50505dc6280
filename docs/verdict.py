"""Where the constants of pipeline/judgement/verdict.py come from: signs of many runs, and a logistic regression.

    python docs/verdict.py LOG.mcap... --reference TRUTH.tum... --building NAME [--runs 2] [--scans N] --keep FOLDER
    python docs/verdict.py LOG.mcap... --map MAP --elsewhere --building NAME --keep FOLDER
    python docs/verdict.py --keep FOLDER

Runs every log and keeps in FOLDER what its scans gave to judge by, and at which the pose was right, within 0.5 m and
10 degrees; a run that is there already is not run again, whatever was changed since. ``--map``: another one than the
log's; with ``--elsewhere`` it is of another building, where no pose is right. Then fits all runs in FOLDER, each of the
same weight, and prints the constants; and what comes out for the runs of each building if they are left out of the fit.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit

from pipeline import load_config, load_map
from pipeline.evaluate.calibration import BINS
from pipeline.evaluate.metrics import interpolate, is_localized, known, laser_to_base, pose_errors
from pipeline.filter.step import TAKEOVERS, Step
from pipeline.judgement import verdict
from pipeline.judgement.verdict import GOOD, SURE, Judge, Signs, stated
from pipeline.localization import localize
from pipeline.logs.messages import Log
from pipeline.logs.reader import read_log
from pipeline.logs.tum import read_tum

Array = NDArray[np.float64]
RIDGE = 1e-3
"""Of the squares of the weights, per standard deviation of what they weigh."""
TRIED = (0.9, 1.0, 1.1, 1.2, 1.3)
"""Nats a beam, beside the GOOD that is in force."""
NAMES = ("PRIOR", "SHARE", "WORTH", "PROVED")


@dataclass(frozen=True)
class Run:
    """A run as it is kept, in a file of its name: ``signs`` (n, 5): time, weight, worth, off, moved, as in ``Signs``;
    ``right``, ``explained`` (n,): of the pose, and of the beams by the map. Scans without reference are left out."""

    name: str

    building: str
    signs: Array
    right: NDArray[np.bool_]
    explained: Array


class Signer:
    """Writes down of every step what a judge hears, where the robot is taken to be, and how much the map explains."""

    def __init__(self) -> None:
        self.signs: list[tuple[float, ...]] = []
        self.poses: list[Array] = []
        self.explained: list[float] = []

    def log(self, step: Step) -> None:
        """Take note of a step."""
        moved = step.motion.unseen is not None or any(event.kind in TAKEOVERS for event in step.events)
        self.signs.append((step.time, step.estimate.weight, step.beams.worth, step.off_map, moved))
        self.poses.append(step.estimate.pose)
        self.explained.append(step.explained)


# --- runs -----------------------------------------------------------------------------------------------------------


def gathered(log: Log, truth: Array | None, name: str, building: str, seed: int) -> Run:
    """Run a log; ``truth`` (n, 3), None if it is of another building than its map."""
    signer = Signer()
    localize(log, load_config(), seed=seed, threads=1, sinks=[signer])
    signs, explained = np.array(signer.signs), np.array(signer.explained)
    right, told = np.zeros(len(signs), np.bool_), np.ones(len(signs), np.bool_)
    if truth is not None:
        right, told = is_localized(*pose_errors(np.array(signer.poses), truth)), known(truth)
    return Run(name, building, signs[told], right[told], explained[told])


def write(run: Run, path: Path) -> None:
    """Keep a run."""
    np.savez_compressed(path, building=run.building, signs=run.signs, right=run.right, explained=run.explained)


def read(path: Path) -> Run:
    """A run that was kept."""
    with np.load(path) as file:
        return Run(path.stem, str(file["building"]), file["signs"], file["right"], file["explained"])


# --- fit ------------------------------------------------------------------------------------------------------------


def regressors(run: Run) -> Array:
    """(n, 4) what the constants weigh: 1, and what a judge makes of the signs."""
    judge = Judge()
    signs = [Signs(t, weight, worth, off, (), bool(moved)) for t, weight, worth, off, moved in run.signs.tolist()]
    return np.array([(1.0, *judge.regressors(each)) for each in signs])


def fitted(xs: Sequence[Array], rights: Sequence[NDArray[np.bool_]]) -> Array:
    """(4,) weights of the regressors ``xs`` (n, 4) each, by which ``rights`` (n,) each are likeliest."""
    x, right = np.vstack(xs), np.concatenate(rights)
    share = np.concatenate([np.full(len(each), 1.0 / (len(each) * len(xs))) for each in xs])
    mean, deviation = x.mean(axis=0), x.std(axis=0)
    mean[0], deviation[0] = 0.0, 1.0
    z, sign = (x - mean) / deviation, np.where(right, 1.0, -1.0)

    def cost(b: Array) -> tuple[float, Array]:
        score, ridge = z @ b, RIDGE * np.append(0.0, b[1:])
        slope = share * (expit(score) - right)
        return float(share @ np.logaddexp(0.0, -sign * score) + ridge @ b), slope @ z + 2.0 * ridge

    weights = minimize(cost, np.zeros(x.shape[1]), jac=True).x / deviation
    weights[0] -= weights[1:] @ mean[1:]
    return np.asarray(weights)


def foretold(runs: Sequence[Run], xs: Sequence[Array]) -> list[Array]:
    """Of each run the probabilities (n,) by a fit to the runs of all buildings but its own."""
    weights = dict[str, Array]()
    for building in {run.building for run in runs}:
        others = [row for row, run in enumerate(runs) if run.building != building]
        weights[building] = fitted([xs[row] for row in others], [runs[row].right for row in others])
    return [
        np.minimum(expit(x @ weights[run.building]), np.sqrt(expit(x[:, 1]))) for x, run in zip(xs, runs, strict=True)
    ]


# --- tables ---------------------------------------------------------------------------------------------------------


def brier(stated: Sequence[Array], runs: Sequence[Run]) -> str:
    """Brier's score, and in brackets that of the base rate: over all scans, and with the same weight for every run."""
    each = np.array([np.square(p - run.right).mean() for p, run in zip(stated, runs, strict=True)])
    right, scans = np.array([run.right.mean() for run in runs]), [len(run.right) for run in runs]
    cells = []
    for weights in (scans, np.ones(len(runs))):
        rate = np.average(right, weights=weights)
        cells.append(f"{np.average(each, weights=weights):.3f} ({rate * (1.0 - rate):.3f})")
    return " | ".join(cells)


def reliability(stated: Sequence[Array], runs: Sequence[Run]) -> None:
    """Print, by ranges of the stated probability, how often the pose was right."""
    p, right = np.concatenate(stated), np.concatenate([run.right for run in runs])
    row = np.clip(np.searchsorted(BINS, p, side="right") - 1, 0, len(BINS) - 2)
    print("\n| stated | scans | mean stated | right |\n|---|---:|---:|---:|")
    for k in range(len(BINS) - 1):
        if (here := row == k).any():
            print(
                f"| {BINS[k]:g} to {BINS[k + 1]:g} | {here.sum():,} | {p[here].mean():.3f} | {right[here].mean():.3f} |"
            )


def second_halves(stated: Sequence[Array], runs: Sequence[Run]) -> None:
    """Print of every run's second half how often the pose was right and the robot found, and what the map explains."""
    print("\n| run | building | right | found | mean stated | beams explained |\n|---|---|---:|---:|---:|---:|")
    for p, run in zip(stated, runs, strict=True):
        late = run.signs[:, 0] > 0.5 * run.signs[-1, 0]
        shares = run.right[late].mean(), (p[late] >= SURE).mean(), p[late].mean(), np.nanmean(run.explained[late])
        print(f"| {run.name} | {run.building} | {' | '.join(f'{share:.2f}' for share in shares)} |")


# --- the command ----------------------------------------------------------------------------------------------------


def gather(asked: argparse.Namespace) -> None:
    """Run what was asked for and is not kept yet."""
    grid = None if asked.map is None else load_map(asked.map)
    for k, path in enumerate(asked.logs):
        log = read_log(path, grid)
        log = log if asked.scans is None else log.part(slice(asked.scans))
        truth = None
        if not asked.elsewhere:
            reference = read_tum(asked.reference[k])
            if asked.reference_frame == "laser":
                reference = laser_to_base(reference, log.laser.pose)
            truth = interpolate(reference, log.stamps)
        name = log.name if asked.map is None else f"{log.name} on {asked.map.parent.name}/{asked.map.stem}"
        for seed in range(asked.runs):
            kept = asked.keep / f"{name} {seed}.npz".replace("/", "-")
            if not kept.exists():
                write(gathered(log, truth, name, asked.building, seed), kept)


def report(runs: Sequence[Run]) -> None:
    """Print the constants that the runs give, and how well those in force and fitted ones foretell."""
    scans, buildings = sum(len(run.right) for run in runs), {run.building for run in runs}
    print(f"{len(runs)} runs, {scans:,} scans, {len(buildings)} buildings")
    print("\nBrier (base rate), of scans | of runs")
    for good in sorted({*TRIED, GOOD}):
        with patch.object(verdict, "GOOD", good):
            xs = [regressors(run) for run in runs]
        weights = fitted(xs, [run.right for run in runs])
        fit = ", ".join(f"{name} {weight:.2f}" for name, weight in zip(NAMES, weights, strict=True))
        left_out = foretold(runs, xs)
        print(f"GOOD {good:g}: {fit}; buildings left out: {brier(left_out, runs)}")
        if good == GOOD:
            by_fit, in_force = left_out, [stated(*x[:, 1:].T) for x in xs]
    print(f"in force: {brier(in_force, runs)}")
    print("\nfitted, each building left out")
    reliability(by_fit, runs)
    print("\nthe constants in force")
    reliability(in_force, runs)
    print("\nsecond halves, by the constants in force")
    second_halves(in_force, runs)


def main() -> None:
    """Run, keep, fit, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("logs", type=Path, nargs="*", metavar="LOG.mcap")
    parser.add_argument("--keep", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--reference", type=Path, action="append", default=[], metavar="TRUTH.tum")
    parser.add_argument("--reference-frame", choices=("base_link", "laser"), default="base_link")
    parser.add_argument("--map", type=Path, metavar="MAP", help="For all logs, instead of their own.")
    parser.add_argument("--elsewhere", action="store_true", help="The map is of another building.")
    parser.add_argument("--building", metavar="NAME", help="Runs of one building are left out of a fit together.")
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("--scans", type=int, help="Only so many, the first of each log.")
    asked = parser.parse_args()
    if asked.logs and not asked.building:
        parser.error("say the --building of the logs")
    if not asked.elsewhere and len(asked.reference) != len(asked.logs):
        parser.error("give one --reference per log, in their order, or say --elsewhere")
    asked.keep.mkdir(parents=True, exist_ok=True)
    gather(asked)
    runs = [read(path) for path in sorted(asked.keep.glob("*.npz"))]
    if len({run.building for run in runs}) < 2:
        print(f"{asked.keep} has {len(runs)} runs of fewer than two buildings: no fit can leave one out")
    else:
        report(runs)


if __name__ == "__main__":
    main()
