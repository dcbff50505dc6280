"""The script that runs the documentation's tables again: what it keeps, what it runs, what it tells."""

from __future__ import annotations

import gzip
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sweep
from sweep_rows import rows

from pipeline.logs.messages import Trajectory
from pipeline.logs.tum import read_tum, write_tum

SECOND = 1_000_000_000
OFFICE = next(row for row in rows() if row.name == "office")


def told(successes: int = 2) -> dict[str, Any]:
    summary = {"median": 0.5, "p95": 0.75, "rmse": 0.5}
    return {
        "runs": 2,
        "successes": successes,
        "time_to_localize": summary,
        "scans_right": summary,
        "position_error": summary,
        "heading_error": None,
        "ate": summary,
        "false_alarms": 0,
        "speed": 100.0,
        "recoveries": [{"kidnapped_at": 3.0, "recovered": 0, "time": None}],
    }


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Commands that evaluate: they are noted, not run; conversions are real."""
    commands: list[list[str]] = []

    def run(command: list[str]) -> tuple[int, str]:
        commands.append(command)
        return 0, json.dumps({"logs": {"office": told()}})

    monkeypatch.setattr(sweep, "_run", run)
    return commands


def test_rows_have_names_of_their_own():
    slugs = [sweep._slug(row.name) for row in rows()]
    assert len(set(slugs)) == len(slugs) == 130


def test_what_is_done_is_not_run_again(ran: list[list[str]], tmp_path: Path):
    for _ in range(2):
        sweep.Sweep(tmp_path, tmp_path / "nothing", 2, 1).run(OFFICE, "1/1")
    (command,) = ran
    assert command[command.index("--runs") + 1] == "2"
    assert Path(command[command.index("--reference") + 1]).read_text()
    sweep.Sweep(tmp_path, tmp_path, 3, 1).run(OFFICE, "1/1")
    sweep.Sweep(tmp_path, tmp_path, 2, 1).run(replace(OFFICE, evaluate=("--set", "max_beams=12")), "1/1")
    assert len(ran) == 3


def test_another_source_runs_everything_anew(tmp_path: Path):
    (tmp_path / "pipeline").mkdir()
    file = tmp_path / "pipeline" / "a.py"
    file.write_text("1\n")
    before = sweep.content(tmp_path, ("pipeline",))
    (tmp_path / "pipeline" / "__pycache__").mkdir()
    (tmp_path / "pipeline" / "__pycache__" / "a.pyc").write_bytes(b"1")
    assert sweep.content(tmp_path, ("pipeline",)) == before
    file.write_text("2\n")
    assert sweep.content(tmp_path, ("pipeline",)) != before


def test_what_is_not_there_or_fails_is_told_and_left_out(
    ran: list[list[str]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    lab = sweep.Sweep(tmp_path, tmp_path, 2, 1)
    lab.run(next(row for row in rows() if row.name == "intel"), "1/2")
    lab.run(replace(OFFICE, convert=("--no-such-option",)), "2/2")
    said = capsys.readouterr().err
    assert "intel: left out: carmen/intel/intel.log.gz is not there" in said
    assert "office: failed: " in said
    assert (lab.failed, ran) == (["office"], [])


def test_a_joined_log_has_the_truth_of_both_at_its_own_stamps(tmp_path: Path):
    from converters import convert
    from pipeline.logs.reader import read_log
    from pipeline.simulate import sample_dir

    sample = sample_dir()
    convert([sample / "office.log.gz"] * 2, tmp_path / "twice.mcap", join=True)
    truth = read_tum(sample / "office_truth.tum")
    sweep._write_truth(tmp_path / "twice.tum", [truth, truth], tmp_path / "twice.mcap")
    both, log = read_tum(tmp_path / "twice.tum"), read_log(tmp_path / "twice.mcap")
    assert len(both.stamps) == 2 * len(truth.stamps)
    assert abs(both.stamps[-1] - log.stamps[-1]) < SECOND


def test_a_thinned_log_has_a_scan_per_metre(tmp_path: Path):
    lines = [f"FLASER 1 2.0 {k / 4} 0 0 {k / 4} 0 0 {k} host {k}\n" for k in range(21)]
    (tmp_path / "a.log.gz").write_bytes(gzip.compress("".join(["# a robot\n", *lines]).encode()))
    poses = np.zeros((21, 3))
    poses[:, 0] = np.arange(21) / 4
    write_tum(tmp_path / "a.tum", Trajectory(np.arange(21, dtype=np.int64) * SECOND, poses))
    thinned = sweep._thinned(tmp_path / "a.log.gz", tmp_path / "a.tum", 1.0, tmp_path / "a.log")
    assert thinned.read_text().splitlines(keepends=True) == ["# a robot\n", *lines[::4]]


def test_the_table_is_markdown():
    heading, _, row = sweep.table([(OFFICE, told())]).splitlines()
    assert heading.count("|") == row.count("|") == len(sweep.COLUMNS) + 1
    assert row == "| office | 2/2 | 0.5 0.8 | 50.0 | 0.500 / 0.750 | - | 0.50 | 0 | 100 | 0/2 | - |"
    fault = {"fault": "turn", "times": 2, "found_again": 2, "at_once": 1, "time": {"median": 0.5, "p95": 3.0}}
    _, _, row = sweep.table([(OFFICE, told() | {"faults": [fault]})]).splitlines()
    assert row.endswith("| 0/2 | turn: 2/2 after 0.5 3.0 s, 1/2 |")
