"""`mcl evaluate` where nobody knows the truth, and its table as a file."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from commands import Command

ROOT = Path(__file__).resolve().parents[2]
QUICKLY = ("--runs", "2", "--jobs", "1", "--set", "recovery=none", "--particles", "500")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, mcl: Command) -> Path:
    """A log without truth: the sample's, of which ten seconds are enough."""
    folder = tmp_path_factory.mktemp("without_truth")
    sample = ROOT / "data" / "sample"
    asked = ("--map", str(sample / "office.dat.gz"), "--drop", "10:1000", "-o", "office.mcap")
    mcl("convert", str(sample / "office.log.gz"), *asked, cwd=folder)
    return folder


def test_it_tells_what_the_seeds_say_and_writes_it(folder: Path, mcl: Command) -> None:
    done = mcl("evaluate", "office.mcap", *QUICKLY, "--table", "seeds.csv", "--plot", "seeds.png", cwd=folder)
    heading, names, row, *written = done.stdout.splitlines()
    assert heading.startswith("the truth is not known")
    assert names.split()[:4] == ["log", "runs", "together", "(%)"]
    assert row.split()[:2] == ["office", "2"]
    assert written == ["seeds.png", "seeds.csv"]
    with (folder / "seeds.csv").open(encoding="utf-8", newline="") as file:
        (told,) = csv.DictReader(file)
    assert f"{100 * float(told['together_all']):.1f}" == row.split()[2]
    assert (folder / "seeds.png").stat().st_size > 10_000


def test_variants_are_compared_and_json_has_it(folder: Path, mcl: Command) -> None:
    asked = ("--vary", "resampler=low_variance,multinomial", "--json", "--table", "seeds.tex")
    done = mcl("evaluate", "office.mcap", *QUICKLY, *asked, cwd=folder)
    told = json.loads(done.stdout)
    assert told["paired"] == []
    (log,) = {name for variant in told["variants"] for name in variant["logs"]}
    assert all(0.0 <= variant["logs"][log]["agreement"]["all"]["stated"] <= 1.0 for variant in told["variants"])
    assert r"low\_variance" in (folder / "seeds.tex").read_text(encoding="utf-8")


@pytest.mark.parametrize("asked", [("--calibration",), ("--require-success", "0.5"), ("--failures", "0.1")])
def test_what_asks_for_the_truth_is_refused_before_any_run(asked: tuple[str, ...], folder: Path, mcl: Command) -> None:
    done = mcl("evaluate", "office.mcap", *QUICKLY, *asked, cwd=folder, code=1)
    assert "--reference" in done.stderr
    assert done.stdout == ""


def test_a_table_is_not_replaced_unasked(folder: Path, mcl: Command) -> None:
    (folder / "there.csv").write_text("mine")
    done = mcl("evaluate", "office.mcap", *QUICKLY, "--table", "there.csv", cwd=folder, code=1)
    assert "--force replaces it" in done.stderr
    done = mcl("evaluate", "office.mcap", *QUICKLY, "--table", "there.xlsx", cwd=folder, code=1)
    assert "a table is one of .csv, .tex" in done.stderr
