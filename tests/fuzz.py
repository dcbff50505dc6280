"""Mangled files into everything that reads them: a result or one MclError, and nothing else, ever.

Allowed: a result whose numbers are finite where they must be, or an MclError of one line. Not allowed: any other
exception, a warning or a word of somebody else's library, more than 60 s, more than 4 GB. Every input follows from
(seed, target, number), so that a fault can be made again:

    python tests/fuzz.py --count 1000000               all targets in turn
    python tests/fuzz.py --only mcap --number 1234     one input, with its traceback
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from fuzz_targets import SLOW, TARGETS  # noqa: E402

from pipeline.errors import MclError  # noqa: E402

SECONDS, BYTES = 60, 4_000_000_000


class TooLong(BaseException):
    """More than 60 s: what catches exceptions of libraries does not catch this."""


@dataclass
class Tally:
    """How it went: inputs by target, how many were refused and read, and the faults."""

    inputs: dict[str, int] = field(default_factory=dict)
    read: dict[str, int] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)


def mangled(target: str, seed: int, number: int) -> tuple[str, bytes]:
    """The input of that number: its name and content."""
    rng = random.Random(f"{seed} {target} {number}")
    seeds = TARGETS[target].seeds()
    name = rng.choice(sorted(seeds))
    return name, TARGETS[target].mangle(seeds[name], rng)


def fault_of(target: str, name: str, content: bytes, folder: Path) -> tuple[str, bool]:
    """What is wrong with how an input is taken, as a text, empty if nothing is; and whether it was read."""
    path = folder / name
    path.write_bytes(content)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    read = False
    try:
        with _silent(folder) as spoken, _limited():
            TARGETS[target].reads(path)
            read = True
    except MclError as error:
        if not str(error).strip() or "\n" in str(error):
            return f"an error that is not one line: {str(error)!r}", read
    except TooLong:
        return f"it takes more than {SECONDS} s", read
    except KeyboardInterrupt:
        raise
    except BaseException:
        return traceback.format_exc(), read
    finally:
        for left in folder.iterdir():
            left.unlink()
    if said := "".join(spoken):
        return f"somebody spoke: {said[:2000]}", read
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    return (f"it takes {grown / 1e9:.1f} GB", read) if grown > BYTES else ("", read)


@contextmanager
def _limited() -> Iterator[None]:
    def end(_number: int, _frame: FrameType | None) -> None:
        raise TooLong

    # By the processor's time, for others may be at work here; and by the clock, for whoever waits uses none.
    before = [(number, signal.signal(number, end)) for number in (signal.SIGPROF, signal.SIGALRM)]
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    signal.alarm(10 * SECONDS)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            yield
    finally:
        signal.alarm(0)
        signal.setitimer(signal.ITIMER_PROF, 0)
        for number, handler in before:
            signal.signal(number, handler)


@contextmanager
def _silent(folder: Path) -> Iterator[list[str]]:
    """What is written to stdout and stderr meanwhile, by whatever language."""
    spoken: list[str] = []
    sys.stdout.flush(), sys.stderr.flush()
    kept = os.dup(1), os.dup(2)
    with tempfile.TemporaryFile() as said:
        os.dup2(said.fileno(), 1)
        os.dup2(said.fileno(), 2)
        try:
            yield spoken
        finally:
            sys.stdout.flush(), sys.stderr.flush()
            os.dup2(kept[0], 1)
            os.dup2(kept[1], 2)
            for descriptor in kept:
                os.close(descriptor)
            said.seek(0)
            spoken.append(said.read().decode(errors="replace"))


def turns(only: Sequence[str], first: int = 0) -> Iterator[tuple[str, int]]:
    """Targets with the numbers of their inputs, in turn, without end."""
    number = first
    while True:
        for target in only:
            every = SLOW.get(target, 1)
            if number % every == 0:
                yield target, number // every
        number += 1


def fuzz(
    count: int, seed: int, only: Sequence[str] = tuple(TARGETS), seconds: float = float("inf"), first: int = 0
) -> Tally:
    """Try so many inputs, or for so many seconds."""
    tally, end = Tally(), time.monotonic() + seconds
    kept = Path(os.environ.get("MCL_FUZZ_DIR", ".fuzz"))
    with tempfile.TemporaryDirectory(prefix="mcl-fuzz-") as home:
        os.environ.setdefault("MCL_CACHE_DIR", home + "/cache")
        folder = Path(home) / "files"
        folder.mkdir()
        for done, (target, number) in enumerate(turns(only, first)):
            if done >= count or time.monotonic() > end:
                break
            name, content = mangled(target, seed, number)
            fault, read = fault_of(target, name, content, folder)
            tally.inputs[target] = tally.inputs.get(target, 0) + 1
            tally.read[target] = tally.read.get(target, 0) + read
            if fault:
                kept.mkdir(parents=True, exist_ok=True)
                (kept / f"{target}-{number}-{name}").write_bytes(content)
                (kept / f"{target}-{number}.txt").write_text(fault)
                tally.faults.append(f"{target} {number}: {fault.strip().splitlines()[-1]}")
    return tally


def main() -> None:
    """As the command line says."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    parser.add_argument("--only", choices=list(TARGETS), action="append")
    parser.add_argument("--number", type=int, help="one input of the target, with its traceback")
    asked = parser.parse_args()
    only = asked.only or list(TARGETS)
    if asked.number is not None:
        name, content = mangled(only[0], asked.seed, asked.number)
        with tempfile.TemporaryDirectory(prefix="mcl-fuzz-") as folder:
            fault, read = fault_of(only[0], name, content, Path(folder))
        print(f"{name}, {len(content):,} bytes: {fault or ('read' if read else 'refused')}")
        sys.exit(bool(fault))
    begun = time.monotonic()
    tally = fuzz(asked.count, asked.seed, only, asked.seconds, asked.first)
    for target, count in tally.inputs.items():
        print(f"{target:<10} {count:>9,} inputs, {tally.read[target]:>9,} of them read")
    print(f"{sum(tally.inputs.values()):,} inputs in {time.monotonic() - begun:.0f} s, {len(tally.faults)} faults")
    for fault in tally.faults[:200]:
        print(fault)
    sys.exit(bool(tally.faults))


if __name__ == "__main__":
    main()
