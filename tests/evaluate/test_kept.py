"""Runs that are kept: not run again, unless anything that decides them is another."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_evaluate import make_log, stub, without_clock

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.evaluate import evaluate, kept
from pipeline.logs.faults import parse_fault


class Counting:
    """A runner that counts its runs; it stops at the ``last`` of them, as Ctrl-C does."""

    def __init__(self, last: int | None = None) -> None:
        self.__module__, self.__qualname__ = stub.__module__, stub.__qualname__
        self.runs, self.last = 0, last

    def __call__(self, *args, **options):
        if self.runs == self.last:
            raise KeyboardInterrupt
        self.runs += 1
        return stub(*args, **options)


def runs(folder: Path, runner: Counting, log=None, config: Config | None = None, **options):
    options = {"runs": 6, "jobs": 1, **options}
    return evaluate([log or make_log()], [None], config or Config(), keep=folder, runner=runner, **options)


def test_a_stopped_evaluation_goes_on_where_it_was(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        runs(tmp_path / "kept", Counting(last=4))
    runner = Counting()
    done = runs(tmp_path / "kept", runner)
    assert runner.runs == 2
    fresh = evaluate([make_log()], [None], Config(), runs=6, jobs=1, runner=stub)
    assert without_clock(done) == without_clock(fresh)
    for a, b in zip(done.logs[0].runs, fresh.logs[0].runs, strict=True):
        np.testing.assert_array_equal(a.poses, b.poses)
        np.testing.assert_array_equal(a.covariances, b.covariances)
        np.testing.assert_array_equal(a.probability, b.probability)
    again = Counting(last=0)
    assert runs(tmp_path / "kept", again).to_dict() == done.to_dict()  # also the clock's figures, as they were


@pytest.mark.parametrize(
    "changes",
    [
        {"config": Config(max_beams=7)},
        {"first_seed": 6},
        {"log": make_log(ranges=np.full((60, 3), 2.0, np.float32))},
        {"log": make_log(grid=replace(make_log().grid, resolution=0.2))},
        {"faults": [parse_fault("turn:30:90")]},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_whatever_decides_a_run_makes_it_another(tmp_path, changes):
    runs(tmp_path, Counting())
    runner = Counting()
    runs(tmp_path, runner, **changes)
    assert runner.runs == 6


def test_other_source_is_another_run(tmp_path, monkeypatch):
    runs(tmp_path, Counting())
    monkeypatch.setattr("pipeline.evaluate.runs.source_checksum", lambda: "other")
    runner = Counting()
    runs(tmp_path, runner)
    assert runner.runs == 6


def test_another_truth_scores_the_same_run(tmp_path):
    runs(tmp_path, Counting())
    log = make_log()
    truth = replace(log.ground_truth, poses=log.ground_truth.poses + np.array([5.0, 0.0, 0.0]))
    done = runs(tmp_path, Counting(last=0), log=replace(log, ground_truth=truth))
    assert done.logs[0].successes == 0


def test_a_damaged_file_is_run_again(tmp_path):
    done = runs(tmp_path, Counting())
    for number, file in enumerate(sorted(tmp_path.iterdir())):
        file.write_bytes(file.read_bytes()[: 200 * number])
    runner = Counting()
    assert without_clock(runs(tmp_path, runner)) == without_clock(done)
    assert runner.runs == 6


def test_processes_keep_as_well(tmp_path):
    evaluate([make_log()], [None], Config(), runs=4, jobs=2, keep=tmp_path, runner=stub)
    assert len(list(tmp_path.iterdir())) == 4
    runs(tmp_path, Counting(last=0), runs=4)


def test_a_place_that_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(MclError, match="cannot be written"):
        runs(tmp_path / "file", Counting())


def test_the_source_is_all_of_it(tmp_path, monkeypatch):
    (tmp_path / "a").mkdir()
    (tmp_path / "__init__.py").write_text("")
    (tmp_path / "a" / "b.py").write_text("x = 1")
    monkeypatch.setattr(kept.pipeline, "__file__", str(tmp_path / "__init__.py"))
    one = kept.source_checksum.__wrapped__()
    (tmp_path / "a" / "b.py").write_text("x = 2")
    assert one != kept.source_checksum.__wrapped__()
