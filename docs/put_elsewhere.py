"""Could anyone know where a robot is that was put elsewhere? Each such failure alone, by particles and by grids.

    python docs/put_elsewhere.py LOG.mcap --reference TRUTH.tum [--rate 0.5] [--failures 13]

Failures are drawn as `mcl evaluate --failures RATE` draws them, seed by seed; of each that puts the robot elsewhere a
piece of the log is cut, from 3 s before to 20 s after. *particles* and *grid* know the place before; *anew* is a grid
that begins after the failure and knows nothing: what the scans from there, the map and the sensor model say together.
A line tells whether the witnesses noticed (a gap), and the share of the belief within 0.45 m of the truth, by seconds.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from pipeline import load_config
from pipeline.evaluate.failures import RECOVERED, draw_failures
from pipeline.evaluate.metrics import interpolate
from pipeline.filter.step import Step
from pipeline.localization import localize
from pipeline.logs.disturbed import disturbed
from pipeline.logs.messages import Log
from pipeline.logs.reader import read_log
from pipeline.logs.tum import read_tum

BEFORE, AFTER, MOMENTS = 3.0, 20.0, (0, 1, 3, 6, 10, 15)
GRID = ("filter=grid", "grid_d=0.2", "grid_a=0.07")


class AtTheTruth:
    """Keeps of every step the share of the belief near the truth (n, 3), and whether there was a gap."""

    def __init__(self, truth: np.ndarray) -> None:
        self._truth = truth
        self.shares: list[float] = []
        self.gaps: list[bool] = []

    def log(self, step: Step) -> None:
        """Take note of a step."""
        x, y, _ = self._truth[step.index]
        near = np.hypot(step.particles[:, 0] - x, step.particles[:, 1] - y) <= RECOVERED[0]
        self.shares.append(float(np.exp(step.log_weights[near]).sum()))
        self.gaps.append(step.motion.gap is not None)


def told(log: Log, truth: np.ndarray, at: int, settings: tuple[str, ...]) -> str:
    """One run over a piece of a log, whose scan ``at`` is the first after the failure."""
    sink = AtTheTruth(truth)
    localize(log, load_config(None, settings), seed=1, threads=1, sinks=[sink])
    times = log.times - log.times[at]
    rows = [min(int(np.searchsorted(times, moment)), len(log) - 1) for moment in MOMENTS]
    shares = " ".join(f"{sink.shares[row]:.2f}" for row in rows)
    return f"{shares}{'  noticed' if sink.gaps[at] else ''}"


def main() -> None:
    """Print three lines for each failure."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("log", type=Path, metavar="LOG.mcap")
    parser.add_argument("--reference", type=Path, required=True, metavar="TRUTH.tum")
    parser.add_argument("--rate", type=float, default=0.5)
    parser.add_argument("--failures", type=int, default=13)
    asked = parser.parse_args()
    log = read_log(asked.log)
    truth = interpolate(read_tum(asked.reference), log.stamps)
    done, seed = 0, -1
    while done < asked.failures:
        seed += 1
        for jump in (f for f in draw_failures(log.times, truth, asked.rate, seed) if f.kind == "jump"):
            made, rows = disturbed(log, [jump])
            cut = int(np.flatnonzero(np.diff(rows) != 1)[0]) + 1
            first, last = np.searchsorted(made.times, made.times[cut] + [-BEFORE, AFTER])
            here, at, true = made.part(slice(first, last)), cut - first, truth[rows[first:last]]
            start = ("init=pose", f"initial_pose={true[0].tolist()}")
            print(f"seed {seed}, {jump.args[0]:.1f} s as if it were {jump.args[1]:.1f} s; after {MOMENTS} s")
            print(f"  particles  {told(here, true, at, start)}")
            print(f"  grid       {told(here, true, at, (*start, *GRID))}")
            print(f"  anew       {told(made.part(slice(cut, last)), true[at:], 0, GRID)}", flush=True)
            done += 1


if __name__ == "__main__":
    main()
