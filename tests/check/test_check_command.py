"""`mcl check`, as it is typed: its answer, its exit codes, its page; and what `localize` says of it."""

from __future__ import annotations

import gzip
import json
import re
from contextlib import chdir
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.logs.messages import Log
from pipeline.simulate import sample_dir

QUICK = ("--particles", 4000)


@pytest.fixture
def typed(tmp_path: Path):
    def run(*words: object) -> Result:
        with chdir(tmp_path):
            return CliRunner(env={"NO_COLOR": "1"}).invoke(app, list(map(str, words)), prog_name="mcl")

    return run


@pytest.fixture(scope="module")
def backwards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sample with two lines swapped."""
    lines = gzip.decompress((sample_dir() / "office.log.gz").read_bytes()).splitlines(keepends=True)
    lines[100], lines[101] = lines[101], lines[100]
    path = tmp_path_factory.mktemp("raw") / "backwards.log"
    path.write_bytes(b"".join(lines))
    return path


def test_a_sound_log_is_told_so(typed, office: Log, tmp_path: Path) -> None:
    done = typed("check", office.path, *QUICK, "-o", tmp_path / "look.html")
    assert done.exit_code == 0, done.output
    assert "findings: nothing was found" in done.stdout
    assert done.stdout.splitlines()[-1] == str(tmp_path / "look.html")
    assert "<svg" in (tmp_path / "look.html").read_text()


def test_what_is_doubtful_fails_only_if_that_is_asked(typed, backwards: Path) -> None:
    done = typed("check", backwards)
    assert done.exit_code == 0, done.output
    assert re.search(r"doubtful  clocks: \d stamps ran backwards", done.stdout)
    assert typed("check", backwards, "--strict").exit_code == 1


def test_what_is_broken_fails_and_json_says_it(typed, office: Log) -> None:
    done = typed("check", office.path, "--set", "occupied_threshold=1", "--set", "free_threshold=0", "--json")
    assert done.exit_code == 1
    told = json.loads(done.stdout)
    assert told["findings"][0]["grade"] == "broken"
    assert {topic["name"] for topic in told["topics"]} >= {"/scan", "/odom"}


def test_a_page_is_never_replaced_unasked(typed, office: Log, tmp_path: Path) -> None:
    (tmp_path / "mine.html").write_text("mine")
    done = typed("check", office.path, "-o", tmp_path / "mine.html")
    assert done.exit_code == 1
    assert "--force" in done.stderr
    assert (tmp_path / "mine.html").read_text() == "mine"


def test_localize_says_nothing_of_a_sound_log_and_three_lines_of_another(
    typed, office: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    quick = (*QUICK, "--no-record", "--set", "recovery=none")
    done = typed("localize", office.path, *quick, "-o", tmp_path / "a")
    assert not [line for line in done.stderr.splitlines() if line.startswith(("broken", "doubtful", "and "))]
    extreme = ("--set", "laser_min_range=3", "--set", "laser_max_range=3.5", "--set", "init=map", "--particles", 50)
    done = typed("localize", office.path, "--no-record", *extreme, "-o", tmp_path / "b")
    lines = [line for line in done.stderr.splitlines() if line.startswith(("broken", "doubtful", "and "))]
    assert 1 <= len(lines) <= 3
    assert any("laser_min_range" in line for line in lines)
    assert np.isfinite(json.loads((tmp_path / "b" / "run.json").read_text())["figures"]["end_pose"]).all()
