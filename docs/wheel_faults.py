"""Which faults of the wheels are named, and how soon: the table of docs/faults.md. Needs no map and no truth.

    python docs/wheel_faults.py LOG.mcap... [--seeds 5] [--fault KIND:ARGS]...

Each fault is made in each log, placed anew for every seed as `mcl evaluate --fault` places it (what leaves nothing to
chance is made once); the wheels and the laser are heard as a filter hears them. A cell tells in how many of them the
fault was named, after how many seconds from its beginning (median), and what else was named, which is wrong.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

import numpy as np

from pipeline.config import Config
from pipeline.logs.disturbed import disturbed
from pipeline.logs.faults import Fault, parse_fault, placed
from pipeline.logs.messages import Log
from pipeline.logs.reader import read_log
from pipeline.motion.witnesses import Witnesses

NAMES = {"no-reverse": "no_reverse", "restart": "restarted"}
"""What a fault is called when it is found, where that is another word than when it is made."""
KINDS = ("none", "dead:0", "dead", "mirrored", "no-reverse", "scale:0.7", "restart", "late:0.3")


def named(log: Log, fault: Fault | None) -> list[tuple[float, str]]:
    """Seconds and kinds of the faults that are named in the log with this one made in it."""
    made = log if fault is None else disturbed(log, [fault])[0]
    witnesses = Witnesses(made.laser, Config())
    motions = [witnesses.update(scan) for scan in made.scans()]
    return [(motion.time, found.kind) for motion in motions for found in motion.faults]


def cell(log: Log, asked: str, seeds: int) -> str:
    """What is said of one fault in one log."""
    if asked == "none":
        return ", ".join(sorted({kind for _, kind in named(log, None)})) or "-"
    after, others = list[float](), Counter[str]()
    made = dict.fromkeys(placed([parse_fault(asked)], log.duration, seed)[0] for seed in range(seeds))
    for fault in made:
        right = NAMES.get(fault.kind, fault.kind)
        found = named(log, fault)
        after += [time - fault.begin for time, kind in found if kind == right][:1]
        others.update({kind for _, kind in found if kind != right})
    soon = f", {np.median(after):.0f} s" if after else ""
    wrong = "".join(f"; {kind} in {count}" for kind, count in others.items())
    return f"{len(after)}/{len(made)}{soon}{wrong}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("logs", type=Path, nargs="+", metavar="LOG.mcap")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--fault", action="append", metavar="KIND:ARGS", help="Of `mcl evaluate`; `none` too.")
    asked = parser.parse_args()
    logs = [read_log(path) for path in asked.logs]
    print(f"| named | {' | '.join(log.name for log in logs)} |\n|---{'|---' * len(logs)}|")
    for fault in asked.fault or KINDS:
        print(f"| `{fault}` | {' | '.join(cell(log, fault, asked.seeds) for log in logs)} |", flush=True)


if __name__ == "__main__":
    main()
