"""The tables of docs/grid.md: how much of the belief is at the true place, by cells of several sizes and by particles.

    python docs/grid.py LOG.mcap [--reference TRUTH.tum] [--reference-frame laser] [--seconds S] [--at T ...]
        [--rows mcl grid coarse fine particles] [--seeds N]

Each row is a run over the log, or its first S seconds: ``mcl`` by the defaults; ``grid`` by ``filter=grid``; ``fine``
and ``coarse`` with cells half and twice as long, ``headings`` and ``few headings`` with turns half and one and a half
times as wide; ``particles`` a plain particle filter from everywhere, with ten million particles at the start and never
fewer than one million.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline import load_config
from pipeline.evaluate.metrics import LOCALIZED, interpolate, known, laser_to_base, pose_errors
from pipeline.filter.step import Step
from pipeline.localization import localize
from pipeline.logs.messages import Log
from pipeline.logs.reader import read_log
from pipeline.logs.tum import read_tum

Array = NDArray[np.float64]
ROWS = {
    "mcl": (),
    "grid": ("filter=grid",),
    "headings": ("filter=grid", "grid_a=0.0175"),
    "few headings": ("filter=grid", "grid_a=0.0525"),
    "fine": ("filter=grid", "grid_d=0.05"),
    "coarse": ("filter=grid", "grid_d=0.2", "grid_a=0.07"),
    "particles": ("init=free_space", "recovery=none", "max_particles=10000000", "min_particles=1000000"),
}
CERTAIN = 0.9


class AtTheTruth:
    """Keeps of every step the share of the belief within 0.5 m and 10 degrees of the truth (n, 3)."""

    def __init__(self, truth: Array) -> None:
        self._truth = truth
        self.shares: list[float] = []

    def log(self, step: Step) -> None:
        """Take note of a step."""
        x, y, yaw = self._truth[step.index]
        near = np.hypot(step.particles[:, 0] - x, step.particles[:, 1] - y) <= LOCALIZED[0]
        near &= np.abs((step.particles[:, 2] - yaw + np.pi) % (2 * np.pi) - np.pi) <= LOCALIZED[1]
        self.shares.append(float(np.exp(step.log_weights[near]).sum()))


def main() -> None:
    """Print a table in Markdown."""
    parser = argparse.ArgumentParser(description="How much of the belief is at the true place.")
    parser.add_argument("log", type=Path)
    parser.add_argument("--reference", type=Path)
    parser.add_argument("--reference-frame", choices=("base_link", "laser"), default="base_link")
    parser.add_argument("--seconds", type=float, default=np.inf)
    parser.add_argument("--at", type=float, nargs="*", default=())
    parser.add_argument("--rows", nargs="*", choices=ROWS, default=("mcl", "grid", "few headings", "coarse"))
    parser.add_argument("--seeds", type=int, default=1, help="of particles; a grid draws none")
    chosen = parser.parse_args()
    log = read_log(chosen.log)
    truth = read_tum(chosen.reference) if chosen.reference else log.ground_truth
    if chosen.reference_frame == "laser":
        truth = laser_to_base(truth, log.laser.pose)
    log = first_seconds(log, chosen.seconds)
    truth = interpolate(truth, log.stamps)
    at = [f"{t:g} s" for t in chosen.at]
    print("| " + " | ".join([log.name, "90 % at (s)", *at, "right (%)", "error (m)", "(deg)", "CPU (s)"]) + " |")
    print("|" + "---|" * (6 + len(at)))
    for row in chosen.rows:
        for seed in range(1 if "filter=grid" in ROWS[row] else chosen.seeds):
            print("| " + " | ".join([row, *figures(log, truth, ROWS[row], chosen.at, seed)]) + " |", flush=True)


def first_seconds(log: Log, seconds: float) -> Log:
    """The log up to so many seconds after its first scan."""
    n = int(np.searchsorted(log.times, seconds, side="right"))
    columns = {
        field.name: value[:n]
        for field in dataclasses.fields(log)
        if isinstance(value := getattr(log, field.name), np.ndarray) and len(value) == len(log)
    }
    return dataclasses.replace(log, **columns)


def figures(log: Log, truth: Array, settings: tuple[str, ...], at: list[float], seed: int) -> list[str]:
    """When the truth has 90 % of the belief; its share at moments; scans right; their errors; seconds of one core."""
    config = load_config(None, ["hindsight=false", *settings])
    sink, begun = AtTheTruth(truth), time.process_time()
    result = localize(log, config, seed=seed, threads=1, sinks=[sink])
    cpu = time.process_time() - begun
    shares, there = np.array(sink.shares), known(truth)
    certain = np.flatnonzero(shares >= CERTAIN)
    position, heading = pose_errors(result.poses, truth)
    right = (position <= LOCALIZED[0]) & (heading <= LOCALIZED[1])
    moments = np.minimum(np.searchsorted(log.times, at), len(log) - 1)
    return [
        f"{log.times[certain[0]]:.1f}" if len(certain) else "-",
        *(f"{shares[k]:.3f}" for k in moments),
        f"{100 * right[there].mean():.1f}",
        f"{np.median(position[right]):.2f}",
        f"{np.degrees(np.median(heading[right])):.1f}",
        f"{cpu:.0f}",
    ]


if __name__ == "__main__":
    main()
