from __future__ import annotations

import os
import subprocess
import sys
from contextlib import chdir
from pathlib import Path

import pytest
from commands import FEW, Command, Journey
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.simulate import sample_dir


@pytest.fixture(scope="session")
def mcl(tmp_path_factory: pytest.TempPathFactory) -> Command:
    """Runs `mcl` as a user would, in a process of its own and a folder of the session's."""
    home = tmp_path_factory.mktemp("home")

    def run(*args: object, code: int | None = 0, cwd: Path = home) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(
            [sys.executable, "-m", "pipeline.cli", *map(str, args)],
            cwd=cwd,
            env=os.environ | {"NO_COLOR": "1"},
            capture_output=True,
            text=True,
            timeout=570,
        )
        assert "Traceback" not in done.stderr
        assert code is None or done.returncode == code, done.stderr
        return done

    return run


@pytest.fixture(scope="module")
def typed_here(tmp_path_factory: pytest.TempPathFactory) -> Command:
    """Runs `mcl` in this process: a hundred times the start of a new one would take minutes."""
    home, runner = tmp_path_factory.mktemp("here"), CliRunner(env={"NO_COLOR": "1"})

    def run(*args: object, code: int = 0, cwd: Path = home) -> subprocess.CompletedProcess[str]:
        words = list(map(str, args))
        with chdir(cwd):
            done = runner.invoke(app, words, prog_name="mcl")
        assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
        assert done.exit_code == code, done.stderr
        return subprocess.CompletedProcess(words, done.exit_code, done.stdout, done.stderr)

    return run


@pytest.fixture(scope="session")
def journey(mcl: Command, tmp_path_factory: pytest.TempPathFactory) -> Journey:
    """Another drive through the sample's building, simulated, converted and localized on one thread."""
    folder = tmp_path_factory.mktemp("journey")
    raw, log, run = folder / "raw", folder / "drive.mcap", folder / "run"
    short = folder / "short.mcap"
    said = mcl("simulate", sample_dir() / "building.yaml", "-o", raw, "--seed", 5).stdout
    truth = ("--ground-truth", raw / "office_truth.tum")
    mcl("convert", raw / "office.log.gz", "--map", raw / "office.dat.gz", *truth, "-o", log)
    first = ("--drop", "40:1000")
    mcl("convert", raw / "office.log.gz", "--map", raw / "office.dat.gz", *truth, *first, "-o", short)
    mcl("localize", log, *FEW, "--seed", 1, "--threads", 1, "-o", run)
    return Journey(said, raw, log, short, run)
