"""Runs over seeds with a runner that costs nothing: what is told of them, and that processes change none of it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from itertools import chain
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.evaluate import (
    COLUMNS,
    COMPARE_COLUMNS,
    RECOVERY_COLUMNS,
    compare_table,
    evaluate,
    plot,
    recovery_table,
    table,
)
from pipeline.evaluate.metrics import laser_to_base
from pipeline.filter.step import Event
from pipeline.geometry import compose
from pipeline.logs.messages import Laser, Log, Trajectory
from pipeline.maps.occupancy_grid import OccupancyGrid

SCANS = 60
SECOND = 1_000_000_000


def make_log(name: str = "ring", **changes) -> Log:
    angle = np.linspace(0, np.pi, SCANS)
    truth = np.stack(
        [5 + 3 * np.cos(angle), 1 + 3 * np.sin(angle), np.mod(angle + np.pi / 2 + np.pi, 2 * np.pi) - np.pi], 1
    )
    stamps = 1_700_000_000 * SECOND + np.arange(SCANS, dtype=np.int64) * SECOND
    occupancy = np.zeros((50, 100), dtype=np.float32)
    occupancy[0] = np.nan
    occupancy[-1] = 1
    log = Log(
        name=name,
        path=Path(f"{name}.mcap"),
        sha256="0" * 64,
        laser=Laser((0.25, 0.0, 0.0), -1.0, 1.0, 3, 0.0, 8.0),
        stamps=stamps,
        odometry=truth,
        ranges=np.ones((SCANS, 3), dtype=np.float32),
        grid=OccupancyGrid(occupancy, 0.1, (0.0, 0.0, 0.2)),
        ground_truth=Trajectory(stamps, truth),
    )
    return replace(log, **changes)


def stub(log: Log, config: Config, *, seed: int, threads: int):
    """A robot that is found after a while that the seed decides; every fourth never is."""
    assert threads == 1
    poses = log.odometry + np.random.default_rng(seed).normal(0, 0.05, (SCANS, 3))
    poses[: SCANS if seed % 4 == 3 else 5 * (seed % 4 + 1), 0] += 10
    nothing = np.zeros(SCANS)
    return SimpleNamespace(
        stamps=log.stamps,
        poses=poses,
        hindsight=log.odometry,
        events=((SCANS - 1, float(SCANS - 1), Event("lost", "lost")), (0, 0.0, Event("started", "started"))),
        seconds={"filter": 0.25},
        particles=nothing,
        ess=nothing,
        mean_likelihood=nothing,
        explained=nothing,
        spread=nothing,
        weights=np.linspace(0.0, 1.0, SCANS),
        probability=np.linspace(0.0, 1.0, SCANS),
        covariances=np.tile(np.diag([0.01, 0.01, 0.001]), (SCANS, 1, 1)),
        converged_at=None,
    )


def failing(log: Log, config: Config, *, seed: int, threads: int):
    if seed == 2:
        raise MclError("the map has no free cell", "lower free_threshold", path="here.yaml", line=3)
    return stub(log, config, seed=seed, threads=threads)


def dying(log: Log, config: Config, *, seed: int, threads: int):
    os._exit(9)


def sleeping(log: Log, config: Config, *, seed: int, threads: int):
    os.write(1, b"running\n")  # in one piece, whoever else writes
    time.sleep(600)


def without_clock(evaluation) -> dict:
    plain = evaluation.to_dict()
    for log in plain["logs"].values():
        for each in (log, *log["seeds"]):
            del each["speed"], each["wall"]
    return plain


def test_the_number_of_processes_changes_nothing():
    logs = [make_log("a"), make_log("b")]
    one, three = (evaluate(logs, [None, None], Config(), runs=5, jobs=jobs, runner=stub) for jobs in (1, 3))
    assert without_clock(one) == without_clock(three)
    for a, b in zip(
        chain.from_iterable(log.runs for log in one.logs),
        chain.from_iterable(log.runs for log in three.logs),
        strict=True,
    ):
        np.testing.assert_array_equal(a.poses, b.poses)


def test_the_figures_of_a_log():
    (log,) = evaluate([make_log()], [None], Config(), runs=8, jobs=1, runner=stub).logs
    told = log.to_dict()
    assert [run["seed"] for run in told["seeds"]] == list(range(8))
    assert (told["runs"], told["successes"], told["success_rate"]) == (8, 6, 0.75)
    assert told["success_interval"][0] < 0.75 < told["success_interval"][1]
    assert told["time_to_localize"]["median"] == 10.0
    assert told["certain_at"]["median"] == np.ceil(0.9 * (SCANS - 1))  # a belief that grows by as much at every scan
    assert [run["time_to_localize"] for run in told["seeds"][:4]] == [5.0, 10.0, 15.0, None]
    assert told["localized_after"]["median"] == 1.0
    right = [run["scans_right"] for run in told["seeds"][:4]]
    assert right == [pytest.approx(1 - missed / SCANS) for missed in (5, 10, 15, SCANS)]
    assert told["scans_right"]["median"] == pytest.approx(1 - 12.5 / SCANS)
    assert 0.02 < told["position_error"]["median"] < 0.1
    assert 1.0 < told["heading_error"]["rmse"] < 5.0  # degrees: 0.05 rad
    assert told["false_alarms"] == 6
    assert told["hindsight_ate"]["median"] == 0.0
    assert told["recoveries"] == []


def test_seeds_start_where_they_are_told():
    evaluation = evaluate([make_log()], [None], Config(), runs=2, jobs=1, first_seed=3, runner=stub)
    assert [(run.seed, run.score.success) for run in evaluation.logs[0].runs] == [(3, False), (4, True)]


def test_json_and_back():
    evaluation = evaluate([make_log(), make_log()], [None, None], Config(max_beams=7), runs=4, jobs=1, runner=stub)
    plain = evaluation.to_dict()
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain
    assert list(plain["logs"]) == ["ring", "ring (2)"]
    assert Config.model_validate(plain["config"]) == evaluation.config
    assert {"python", "numpy", "numba", "mcl-replay"} <= plain["versions"].keys()


def test_scans_right_are_a_column():
    evaluation = evaluate([make_log()], [None], Config(), runs=1, jobs=1, runner=stub)
    (row,) = table(evaluation)
    assert row[COLUMNS.index("right (%)")] == "91.7"  # the first 5 of 60 scans are wrong
    assert row[COLUMNS.index("after (%)")] == "100.0"


def test_nothing_found_is_told_as_null_and_dash():
    evaluation = evaluate([make_log()], [None], Config(), runs=1, jobs=1, first_seed=3, runner=stub)
    told = evaluation.to_dict()["logs"]["ring"]
    assert told["time_to_localize"] is told["position_error"] is told["localized_after"] is None
    (row,) = table(evaluation)
    assert row[:5] == ("ring", "0/1", "0-79", "-", "-")


def test_a_reference_of_the_laser_is_taken_back_to_base_link():
    log = make_log()
    assert log.ground_truth is not None
    of_laser = Trajectory(log.stamps, compose(log.ground_truth.poses, log.laser.pose))
    ours = evaluate([log], [of_laser], Config(), runs=1, jobs=1, reference_frame="laser", runner=stub)
    np.testing.assert_allclose(ours.logs[0].truth, laser_to_base(of_laser, log.laser.pose).poses, atol=1e-9)
    np.testing.assert_allclose(ours.logs[0].truth[:, :2], log.ground_truth.poses[:, :2], atol=1e-9)


def test_kidnappings_come_from_the_call_or_from_the_log():
    told = evaluate([make_log()], [None], Config(), runs=4, jobs=1, kidnapped_at=[30.0], runner=stub)
    log = make_log(metadata={"simulation": {"kidnapped_at": "[30.0, 45.5]"}, "source": {"file": "x"}})
    written = evaluate([log], [None], Config(), runs=4, jobs=1, runner=stub)
    assert told.to_dict()["logs"]["ring"]["recoveries"] == [
        {"kidnapped_at": 30.0, "recovered": 3, "time": {"median": 0.0, "p95": 0.0, "rmse": 0.0}}
    ]
    assert [row[1:3] for row in recovery_table(written)] == [("30.0", "3/4"), ("45.5", "3/4")]
    assert {len(row) for row in recovery_table(written)} == {len(RECOVERY_COLUMNS)}


def test_tables_have_a_row_per_log_and_configuration():
    one = evaluate([make_log("a"), make_log("b")], [None, None], Config(), runs=4, jobs=1, runner=stub)
    two = evaluate([make_log("b")], [None], Config(), runs=4, jobs=1, runner=stub)
    assert [row[0] for row in table(one)] == ["a", "b"]
    assert {len(row) for row in table(one)} == {len(COLUMNS)}
    rows = compare_table([("coarse", one), ("fine", two)])
    assert [row[:2] for row in rows] == [("a", "coarse"), ("b", "coarse"), ("b", "fine")]
    assert {len(row) for row in rows} == {len(COMPARE_COLUMNS)}


def test_progress_sees_every_run():
    seen = []

    def progress(items, total, label):
        for item in items:
            seen.append((item.seed, total))
            yield item

    evaluate([make_log()], [None], Config(), runs=3, jobs=1, progress=progress, runner=stub)
    assert seen == [(0, 3), (1, 3), (2, 3)]


# --- what goes wrong


def test_a_reference_of_another_time_is_one_clear_line():
    other = Trajectory(np.array([0, SECOND], dtype=np.int64), np.zeros((2, 3)))
    with pytest.raises(MclError, match=r"does not overlap the log in time: it covers 0\.000 to 1\.000 s") as caught:
        evaluate([make_log()], [other], Config(), runs=1, jobs=1, runner=stub)
    assert "\n" not in str(caught.value)


def test_as_many_references_as_logs():
    with pytest.raises(MclError, match="1 logs but 2 references"):
        evaluate([make_log()], [None, None], Config(), runs=1, jobs=1, runner=stub)
    with pytest.raises(MclError, match="at least 1"):
        evaluate([make_log()], [None], Config(), runs=0, jobs=1, runner=stub)


@pytest.mark.parametrize("at", [SCANS + 5.0, 0.0, -3.0, float("nan"), float("inf")])
def test_a_kidnapping_outside_the_log_is_known_before_any_run(at):
    def runner(*_, **__):
        raise AssertionError("it ran")

    with pytest.raises(MclError, match=r"ring\.mcap: kidnapped at .* the log runs from 0 to 59 s"):
        evaluate([make_log()], [None], Config(), runs=1, jobs=1, kidnapped_at=[30.0, at], runner=runner)


@pytest.mark.parametrize("jobs", [1, 2])
def test_the_error_of_a_run_arrives_whole(jobs):
    with pytest.raises(MclError) as caught:
        evaluate([make_log()], [None], Config(), runs=4, jobs=jobs, runner=failing)
    assert str(caught.value) == "here.yaml:3: the map has no free cell (lower free_threshold)"
    assert caught.value.hint == "lower free_threshold"


def test_a_process_that_dies_is_told_in_one_line():
    with pytest.raises(MclError, match="a process of the evaluation died"):
        evaluate([make_log()], [None], Config(), runs=4, jobs=2, runner=dying)


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_ctrl_c_ends_the_pool_and_says_nothing_of_it():
    script = (
        "import sys; sys.path[:0] = {path!r}\n"
        "import test_evaluate as t\n"
        "if __name__ == '__main__':\n"
        "    try: t.evaluate([t.make_log()], [None], t.Config(), runs=4, jobs=2, runner=t.sleeping)\n"
        "    except KeyboardInterrupt:\n"
        "        import multiprocessing\n"
        "        print('children', len(multiprocessing.active_children()))\n"
    )
    here = Path(__file__)
    path = [str(here.parent), str(here.parents[2])]
    with subprocess.Popen(
        [sys.executable, "-c", script.format(path=path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            assert process.stdout is not None
            assert [process.stdout.readline() for _ in range(2)] == ["running\n"] * 2
            os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the whole group
            out, err = process.communicate(timeout=60)
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)
            raise
    assert (out, err) == ("children 0\n", "")


# --- the picture


@pytest.mark.parametrize("names", [["ring"], ["a", "b"]])
def test_the_plot_is_a_png(tmp_path, names):
    logs = [make_log(name) for name in names]
    evaluation = evaluate(logs, [None] * len(logs), Config(), runs=6, jobs=1, kidnapped_at=[30.0], runner=stub)
    plot(evaluation, tmp_path / "out.png")
    with Image.open(tmp_path / "out.png") as image:
        assert image.format == "PNG"
        assert image.width > 1000


def test_a_plot_needs_neither_map_nor_success(tmp_path):
    log = make_log(grid=None)
    evaluation = evaluate([log], [None], Config(), runs=1, jobs=1, first_seed=3, runner=stub)
    plot(evaluation, tmp_path / "out.png")
    assert (tmp_path / "out.png").stat().st_size > 0
