"""Faults from the command line: made by convert or by evaluate, noted, judged, and drawn."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from commands import FEW, Command, Journey

from pipeline.simulate import sample_dir


def test_a_fault_that_was_converted_is_judged(typed_here: Command, tmp_path: Path) -> None:
    sample, log = sample_dir(), tmp_path / "wrong.mcap"
    known = ("--map", sample / "office.dat.gz", "--ground-truth", sample / "office_truth.tum")
    made = typed_here(
        "convert", sample / "office.log.gz", *known, "--fault", "turn", "--fault", "restart:60", "-o", log
    )
    assert "fault     turn:" in made.stderr
    assert "fault     restart:60\n" in made.stderr
    told = typed_here("evaluate", log, "--runs", 1, "--jobs", 1).stdout
    assert "found again" in told.partition("\nfaults\n")[2]
    assert "restart:60" in told.partition("\nfaults\n")[2]


def test_the_same_fault_is_made_by_evaluate(typed_here: Command, journey: Journey) -> None:
    """The wheels stand still from the start, and who believes nobody else stays where it was."""
    options = (*FEW, "--set", "odometry=wheels", "--runs", 1, "--jobs", 1, "--seed", 1, "--json")
    sound, dead = (
        json.loads(typed_here("evaluate", journey.log, *options, *fault).stdout)["logs"]["drive"]
        for fault in ((), ("--fault", "dead:0"))
    )
    assert sound["successes"] == 1
    assert dead["successes"] == 0
    assert dead["scans_right"]["median"] < 0.5 < sound["scans_right"]["median"]


@pytest.mark.parametrize("rates", [pytest.param((0.1,), marks=pytest.mark.slow), (0.1, 0.2)])
def test_failures_on_the_way(typed_here: Command, journey: Journey, tmp_path: Path, rates: tuple[float, ...]) -> None:
    plot = tmp_path / "rates.png"
    asked = [word for rate in rates for word in ("--failures", rate)]
    done = typed_here("evaluate", journey.log, *FEW, "--runs", 1, "--jobs", 1, *asked, "--plot", plot)
    table = done.stdout.partition("\nfaults\n")[2]
    assert table.count("any failure") == len(rates)
    assert done.stderr.count("a share wants 50") == len(rates)
    assert plot.stat().st_size > 5_000


def test_a_simulated_fault_is_noted_in_the_file(typed_here: Command, tmp_path: Path) -> None:
    done = typed_here(
        "simulate", sample_dir() / "building.yaml", "-o", tmp_path, "--seed", 5, "--fault", "slide:30:1:1"
    )
    assert re.search(r"^  fault +slide:30:1:1$", done.stderr, re.M)
    assert (tmp_path / "office.mcap").exists()
