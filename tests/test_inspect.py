"""A recording alone tells what run it is of, and gives the trajectory back exactly."""

import json
import os
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent / "recording"))

from synthetic import drive, steps

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.inspect import export_trajectory, inspect
from pipeline.logs.messages import Trajectory
from pipeline.recording import run_folder
from pipeline.recording.rerun_sink import RerunSink

SUMMARY = {"converged_at": 8.6, "rmse": np.float64(0.1), "timings": {"start": 0.5, "filter": 1.25}}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = run_folder.create("log", tmp_path_factory.mktemp("run") / "run")
    log = drive(150)
    seen = list(steps(log, 30))
    with RerunSink(folder.recording, log=log, config=Config(max_particles=30), seed=7) as sink:
        for step in seen:
            sink.log(step)
        sink.finish(SUMMARY)
    poses = np.stack([step.estimate.pose for step in seen])
    folder.write_trajectory(Trajectory(log.stamps, poses))
    return folder, log, seen


def test_says_what_was_run(run):
    folder, log, _ = run
    found = inspect(folder.recording)
    assert (found.log, found.log_sha256, found.map_sha256) == (log.name, log.sha256, log.grid.sha256)
    assert (found.scans, found.log_scans, found.seed) == (150, 150, 7)
    assert Config.model_validate(found.config) == Config(max_particles=30)
    assert found.versions["rerun-sdk"].startswith("0.41")
    assert found.timings == pytest.approx({"start": 0.5, "filter": 1.25})
    assert found.figures == {"converged_at": 8.6, "rmse": 0.1}
    assert found.duration == pytest.approx(log.duration)
    assert found.damage == ""


def test_a_run_folder_will_do(run):
    folder, _, _ = run
    assert inspect(folder.path).path == folder.recording


def test_events_and_convergence(run):
    folder, _, seen = run
    found = inspect(folder.recording)
    told = [(s.index, s.time, e.kind, e.level, e.text) for s in seen for e in s.events]
    assert [(e.scan, pytest.approx(e.time), e.kind, e.level, e.text) for e in found.events] == told
    assert found.converged_at == pytest.approx(next(time for _, time, kind, _, _ in told if kind == "converged"))


def test_pose_at_a_time_is_the_last_until_then(run):
    folder, log, seen = run
    found = inspect(folder.recording)
    at = found.pose_at(float(found.times[10]))
    assert (at.scan, at.stamp) == (10, int(log.stamps[10]))
    assert (at.x, at.y, at.yaw) == tuple(seen[10].estimate.pose)
    assert found.pose_at(float(found.times[11]) - 1e-6).scan == 10
    for outside in (-0.1, log.duration + 1.0, float("nan")):
        with pytest.raises(MclError, match="no estimate"):
            found.pose_at(outside)


def test_a_gap_is_known(run):
    found = inspect(run[0].recording)
    times = found.times.copy()
    times[60:] += 30.0
    gapped = replace(found, times=times)
    for asked in (times[59] + 0.01, times[59] + 15.0, times[60] - 0.01):
        assert gapped.pose_at(asked).scan == 59
        assert gapped.gap_at(asked) == (times[59], times[60])
    for asked in (times[0], times[59], times[60], times[61] - 1e-6, times[-1], -5.0, times[-1] + 5.0):
        assert gapped.gap_at(asked) is None
    assert found.gap_at(float(found.times[59]) + 1e-3) is None


def test_a_folder_of_runs_names_them_newest_first(run, tmp_path):
    names = ["log/2026-01-02", "log/2026-01-01", "other/z"]
    for age, name in enumerate(names):
        (tmp_path / name).mkdir(parents=True)
        copy = shutil.copy(run[0].recording, tmp_path / name)
        os.utime(copy, (1_000_000 - age, 1_000_000 - age))
    named = ", ".join(str(tmp_path / name) for name in names)
    assert complaint(tmp_path) == f"{tmp_path}: holds 3 runs, newest first: {named} (name one of them)"
    assert "holds 2 runs" in complaint(tmp_path / "log")
    assert complaint(tmp_path / "other").endswith("other/z (name that one)")
    (tmp_path / "none").mkdir()
    assert "no run.rrd in it" in complaint(tmp_path / "none")


def test_of_many_runs_only_some_are_named(run, tmp_path):
    for k in range(20):
        (tmp_path / f"{k}").mkdir()
        (tmp_path / f"{k}" / "run.rrd").touch()
    assert "and 12 more" in complaint(tmp_path)


def test_exported_trajectory_equals_the_run_s(run, tmp_path):
    folder, _, _ = run
    out = tmp_path / "out.tum"
    export_trajectory(folder.recording, out)
    assert out.read_bytes() == folder.trajectory.read_bytes()
    with pytest.raises(MclError, match="exists"):
        export_trajectory(folder.recording, out)


def test_is_json_and_prints_as_rows(run):
    found = inspect(run[0].recording)
    assert json.loads(json.dumps(found.to_dict()))["scans"] == 150
    rows = {entity.path: entity for entity in found.entities}
    assert rows["/world/particles"].rows == 150
    assert rows["/world/map"].rows == 1
    for table in (found.summary_rows(), found.entity_rows(), found.event_rows()):
        assert all(isinstance(cell, str) for row in table for cell in row)


def test_what_is_no_recording_is_said_so(tmp_path):
    (tmp_path / "text.rrd").write_text("not a recording")
    (tmp_path / "empty.rrd").write_bytes(b"")
    for name, said in (("text.rrd", "not a rerun"), ("empty.rrd", "not a rerun"), ("none.rrd", "no such")):
        with pytest.raises(MclError, match=said):
            inspect(tmp_path / name)


def test_a_stranger_s_recording_is_said_so(tmp_path):
    import rerun as rr

    path = tmp_path / "other.rrd"
    stream = rr.RecordingStream("somebody_else")
    stream.save(path)
    stream.log("/x", rr.TextLog("hello"))
    stream.disconnect()
    with pytest.raises(MclError, match="not written by"):
        inspect(path)


def complaint(path):
    """What inspecting says is wrong, if it gives up."""
    try:
        inspect(path)
    except MclError as error:
        return str(error)
    return ""


def test_a_cut_file_is_read_up_to_the_cut(run, tmp_path):
    whole = run[0].recording.read_bytes()
    scans = []
    for share in (0.3, 0.6, 0.9, 0.999):
        path = tmp_path / f"{share}.rrd"
        path.write_bytes(whole[: int(len(whole) * share)])
        found = inspect(path)
        assert found.damage
        assert found.seed == 7
        assert (found.stamps == run[1].stamps[: found.scans]).all()
        scans.append(found.scans)
    assert scans == sorted(scans)
    assert scans[0] < scans[-1]


def test_damaged_bytes_never_end_in_a_traceback(run, tmp_path):
    whole = run[0].recording.read_bytes()
    rng = np.random.default_rng(0)
    path = tmp_path / "broken.rrd"
    for _ in range(20):
        broken = bytearray(whole[: int(rng.integers(20, len(whole)))])
        at = int(rng.integers(12, len(broken)))
        broken[at : at + 32] = rng.bytes(32)
        path.write_bytes(broken)
        assert "\n" not in complaint(path)
