"""Runs to export: a synthetic one, with a truth, that loses its way."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "recording"))

from synthetic import drive, steps

from pipeline.config import Config
from pipeline.export.run import Run, read_run
from pipeline.filter.beam_model import mixture_density
from pipeline.logs.messages import Trajectory
from pipeline.recording import run_folder
from pipeline.recording.rerun_sink import RerunSink
from pipeline.recording.run_folder import RunFolder

EDGES = np.linspace(0.0, 10.0, 41)


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """150 scans of 30 particles, converged at scan 46, lost at scan 105."""
    made = run_folder.create("log", tmp_path_factory.mktemp("run") / "run")
    log = drive(150, origin=(-10.0, 5.0, 0.3))
    seen = list(steps(log, 30))
    with RerunSink(made.recording, log=log, config=Config(), seed=7) as sink:
        for step in seen:
            sink.log(step)
        sink.finish({"converged_at": 9.2}, log.ground_truth.poses)
    made.write_trajectory(Trajectory(log.stamps, np.stack([step.estimate.pose for step in seen])))
    return made


@pytest.fixture(scope="session")
def run(folder: RunFolder) -> Run:
    return read_run(folder.path)


@pytest.fixture(scope="session")
def recorded_sensor(run: Run) -> tuple[Run, np.ndarray, np.ndarray]:
    """The run, and the sensor model that was recorded with it: edges of the bins and mean densities."""
    fine = (np.arange(4000) + 0.5) / 400
    return run, EDGES, mixture_density(fine, 5.0, Config(), 20.0).reshape(40, 100).mean(axis=1)
