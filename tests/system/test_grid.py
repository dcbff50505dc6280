"""`filter=grid` on the command line: recorded, inspected and evaluated as any other run."""

from __future__ import annotations

import json
from pathlib import Path

from commands import Command, Journey

COARSE = ("--set", "grid_d=0.2", "--set", "grid_a=0.07", "--set", "record_particles=200")


def test_a_run_on_a_grid_is_a_run(typed_here: Command, journey: Journey, tmp_path: Path) -> None:
    run = tmp_path / "run"
    said = typed_here("localize", journey.log, "--set", "filter=grid", *COARSE, "-o", run).stderr
    assert "true: found" in said
    truth = json.loads((run / "run.json").read_text(encoding="utf-8"))["truth"]
    assert 0.0 < truth["certain_at"] < 20.0
    assert truth["success"]
    assert "converged" in typed_here("inspect", run).stdout
    at = typed_here("inspect", run, "--at", 30).stdout
    assert "sigma" in at
    assert (run / "trajectory_hindsight.tum").is_file()


def test_it_is_evaluated_beside_particles(typed_here: Command, journey: Journey) -> None:
    told = typed_here(
        "evaluate", journey.short, "--vary", "filter=mcl,grid", *COARSE, "--runs", 1, "--jobs", 1, "--particles", 3000
    ).stdout
    _, second = told.split("90 % of the belief at the true place")
    assert [line.split()[1:3] for line in second.splitlines() if line.split()[1:2] in (["mcl"], ["grid"])] == [
        ["mcl", "1/1"],
        ["grid", "1/1"],
    ]
