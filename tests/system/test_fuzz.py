"""A share of `make fuzz`: mangled files into everything that reads files, the same ones every time."""

from __future__ import annotations

import random
from pathlib import Path

import fuzz
import fuzz_targets
import mangling
import pytest

SECONDS = 90.0
"""By then even a slow machine is done."""


@pytest.mark.parametrize(
    ("targets", "count"),
    [
        (("mcap", "own", "bag-mcap"), 180),
        (("bag", "db3"), 8),
        (("cmu", "carmen", "beesoft", "tum"), 320),
        (("map", "image", "tf"), 300),
        (("config", "nav2", "building"), 40),
        (("rrd",), 6),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, tuple) else "",
)
def test_a_result_or_one_line(
    targets: tuple[str, ...], count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MCL_FUZZ_DIR", str(tmp_path))
    tally = fuzz.fuzz(count, seed=20, only=targets, seconds=SECONDS)
    assert tally.faults == []
    assert sum(tally.inputs.values()) == count
    assert 0 < sum(tally.read.values()) < count  # some are mangled too little to matter, others are refused


@pytest.mark.parametrize(
    ("target", "number", "seed"),
    [
        ("nav2", 119, 1),
        ("carmen", 78, 0),
        ("carmen", 89, 0),
        ("own", 42, 0),
        ("bag", 8, 2),
        ("bag", 252, 2),
        ("tum", 515, 2),
        ("mcap", 148, 3),
        ("building", 95, 3),
        ("config", 718, 2),
        ("bag-mcap", 1290, 2),
    ],
)
def test_what_once_went_wrong(target: str, number: int, seed: int, tmp_path: Path) -> None:
    name, content = fuzz.mangled(target, seed, number)
    fault, _ = fuzz.fault_of(target, name, content, tmp_path)
    assert fault == ""


def test_a_mangler_mangles_and_the_same_generator_mangles_alike() -> None:
    for target in fuzz.TARGETS.values():
        seeds = target.seeds()
        name, content = next(iter(seeds.items()))
        once = [target.mangle(content, random.Random(k)) for k in range(8)]
        assert once == [target.mangle(content, random.Random(k)) for k in range(8)]
        assert sum(mangled != content for mangled in once) >= 6, name


@pytest.mark.parametrize("how", ["raises", "warns", "speaks", "says nothing", "hangs"])
def test_whatever_must_not_be_is_seen(how: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import os
    import time
    import warnings

    from pipeline.errors import MclError

    def wrong(_: Path) -> None:
        if how == "raises":
            raise ValueError("no")
        if how == "warns":
            warnings.warn("look", stacklevel=1)
        if how == "speaks":
            os.write(2, b"hello")
        if how == "says nothing":
            raise MclError("")
        if how == "hangs":
            while True:
                time.process_time()

    monkeypatch.setattr(fuzz, "SECONDS", 1)
    monkeypatch.setitem(fuzz.TARGETS, "wrong", fuzz_targets.Target(dict, mangling.of_bytes, wrong))
    assert fuzz.fault_of("wrong", "a", b"", tmp_path)[0]
