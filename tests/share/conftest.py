from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "recording"))

from synthetic import drive, steps

from pipeline.config import Config
from pipeline.judgement.verdict import Verdict
from pipeline.recording import run_folder
from pipeline.recording.rerun_sink import RerunSink


def record(folder: Path, seed: int, *, noise: int = 0, lost_from: int = 150) -> Path:
    """A run of 150 scans of 30 particles, with a truth; from a scan on it is lost, if asked for."""
    made = run_folder.create("log", folder / "run")
    log = drive(150, origin=(-10.0, 5.0, 0.3))
    with RerunSink(made.recording, log=log, config=Config(), seed=seed) as sink:
        for step in steps(log, 30, seed=noise):
            sink.log(replace(step, verdict=Verdict("lost", 0.3)) if step.index >= lost_from else step)
        sink.finish({"converged_at": 9.2}, log.ground_truth.poses)
    return made.path


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run: 150 scans of 30 particles, with a truth."""
    return record(tmp_path_factory.mktemp("shared"), 7)


@pytest.fixture(scope="session")
def another(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One of the same log that is lost at the end."""
    return record(tmp_path_factory.mktemp("another"), 8, noise=1, lost_from=140)
