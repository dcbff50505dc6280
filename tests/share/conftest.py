from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "recording"))

from synthetic import drive, steps

from pipeline.config import Config
from pipeline.recording import run_folder
from pipeline.recording.rerun_sink import RerunSink


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run: 150 scans of 30 particles, with a truth."""
    made = run_folder.create("log", tmp_path_factory.mktemp("shared") / "run")
    log = drive(150, origin=(-10.0, 5.0, 0.3))
    with RerunSink(made.recording, log=log, config=Config(), seed=7) as sink:
        for step in steps(log, 30):
            sink.log(step)
        sink.finish({"converged_at": 9.2}, log.ground_truth.poses)
    return made.path
