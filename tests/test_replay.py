"""One whole run: what it leaves, and what it does not when it is stopped."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

from pipeline.config import Config
from pipeline.evaluate.metrics import interpolate, score
from pipeline.inspect import inspect
from pipeline.logs.messages import Log, Scan, Trajectory
from pipeline.recording.run_folder import create
from pipeline.replay import Progress, replay

QUICK = Config(max_particles=200, min_particles=200, init="free_space", recovery="none", record_particles=10)


def carried_off(log: Log, *at: float) -> Log:
    return dataclasses.replace(log, metadata={"mcl:source": {"kidnapped_at": json.dumps(at)}})


def test_every_stretch_of_a_kidnapped_log_is_scored(office: Log, tmp_path: Path) -> None:
    run = replay(carried_off(office, 30.0, 60.5), QUICK, create("x", tmp_path / "run"), record=False)
    truth = interpolate(office.ground_truth, office.stamps)
    assert run.score == score(
        office.times, run.result.poses, truth, kidnapped_at=[30.0, 60.5], hindsight=run.result.hindsight
    )
    told = json.loads((tmp_path / "run" / "run.json").read_text())["truth"]["recoveries"]
    assert [recovery["kidnapped_at"] for recovery in told] == [30.0, 60.5]


def test_a_truth_that_misses_a_stretch_costs_the_score_and_not_the_run(office: Log, tmp_path: Path) -> None:
    early = Trajectory(office.ground_truth.stamps[:50], office.ground_truth.poses[:50])
    log = dataclasses.replace(carried_off(office, 30.0), ground_truth=early)
    run = replay(log, QUICK, create("x", tmp_path / "run"), record=False)
    assert run.score is None
    assert (tmp_path / "run" / "trajectory.tum").exists()


def stopped_after(scans: int, error: type[BaseException]) -> Progress:
    def progress(items: Iterable[Scan], total: int, label: str) -> Iterator[Scan]:
        for scan in items:
            if scan.index == scans:
                raise error
            yield scan

    return progress


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit, MemoryError])
@pytest.mark.parametrize("record", [True, False])
def test_a_run_stopped_before_its_first_scan_leaves_nothing(
    office: Log, tmp_path: Path, error: type[BaseException], record: bool
) -> None:
    for _ in range(2):  # and so the name is free for another try
        with pytest.raises(error):
            replay(office, QUICK, create("x", tmp_path / "run"), record=record, progress=stopped_after(0, error))
        assert not list(tmp_path.iterdir())


def test_a_run_stopped_later_keeps_what_was_recorded(office: Log, tmp_path: Path) -> None:
    folder = create("x", tmp_path / "run")
    with pytest.raises(KeyboardInterrupt):
        replay(office, QUICK, folder, progress=stopped_after(1, KeyboardInterrupt))
    assert {path.name for path in folder.path.iterdir()} == {"run.rrd", "config.yaml"}
    assert inspect(folder.path).scans == 1


def test_without_a_recording_a_stopped_run_leaves_nothing(office: Log, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        replay(office, QUICK, create("x", tmp_path / "run"), record=False, progress=stopped_after(5, KeyboardInterrupt))
    assert not list(tmp_path.iterdir())
