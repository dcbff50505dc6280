"""Laser odometry as a capability and as a command, with witnesses whose words are known beforehand."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.evaluate.drift import Relations
from pipeline.geometry import between, compose
from pipeline.logs import schema
from pipeline.logs.mcap_file import McapFile
from pipeline.logs.messages import Log, Trajectory
from pipeline.logs.reader import read_log
from pipeline.logs.recorded import Names
from pipeline.logs.tum import read_tum
from pipeline.odometry import (
    BOTH,
    DRIFT_COLUMNS,
    LASER,
    RELATION_COLUMNS,
    WHEELS,
    drift_table,
    judge,
    laser_odometry,
    reckonings_beside,
    relation_table,
    wheel_odometry,
    write_mcap,
)

TOO_LONG = 1.01


class Stretched:
    """Witnesses that tell the wheels' steps, each a hundredth too long; alone, twice as much."""

    made: list[tuple[str, bool]]

    def __init__(self, laser, config, wheels=True):
        type(self).made.append((getattr(config, "odometry", "both"), wheels))
        self._factor = TOO_LONG if wheels else TOO_LONG**2
        self._pose = self._last = None

    def update(self, scan):
        if self._pose is None:
            self._pose = scan.odometry
        else:
            self._pose = compose(self._pose, between(self._last, scan.odometry) * [self._factor, self._factor, 1.0])
        self._last = scan.odometry
        return SimpleNamespace(pose=self._pose, faults=())


@pytest.fixture(autouse=True)
def stretched(monkeypatch: pytest.MonkeyPatch) -> type[Stretched]:
    module = ModuleType("pipeline.motion.witnesses")
    Stretched.made = []
    module.Witnesses = Stretched  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "pipeline.motion.witnesses", module)
    return Stretched


@pytest.fixture
def typed():
    return lambda *args: CliRunner().invoke(app, [str(arg) for arg in args])


# --- the capability


def test_the_path_starts_with_the_odometry_and_has_a_pose_for_every_scan(office: Log, stretched):
    found = laser_odometry(office, Config())
    assert (found.by, stretched.made) == (BOTH, [("both", True)])
    np.testing.assert_array_equal(found.stamps, office.stamps)
    np.testing.assert_array_equal(found.poses[0], office.odometry[0])
    assert (found.seconds > 0).all()
    assert found.driven == pytest.approx(TOO_LONG * wheel_odometry(office).driven, rel=0.02)


def test_the_laser_alone_is_asked_without_wheels(office: Log, stretched):
    assert laser_odometry(office, Config(), alone=True).by == LASER
    assert laser_odometry(replace(office, wheels=False), Config()).by == LASER
    assert stretched.made == [("laser", False)] * 2


def test_each_is_compared_with_the_others(office: Log):
    for alone in (False, True):
        first = laser_odometry(office, Config(), alone=alone)
        beside = reckonings_beside(office, Config(), first)
        assert [each.by for each in beside] == [BOTH, LASER, WHEELS]
        assert any(each is first for each in beside)
    lone = replace(office, wheels=False)
    assert reckonings_beside(lone, Config(), first) == [first]
    with pytest.raises(MclError, match="no odometry"):
        wheel_odometry(lone)


def test_drift_is_against_the_reference_given_or_the_logs_own(office: Log):
    wheels = wheel_odometry(office)
    exact = Trajectory(office.stamps, compose((1.0, 2.0, 0.5), office.odometry))
    (of_base,) = judge(office, [wheels], exact)
    of_laser = Trajectory(office.stamps, compose(exact.poses, office.laser.pose))
    (by_laser,) = judge(office, [wheels], of_laser, reference_frame="laser")
    (by_log,) = judge(office, [wheels])
    for each in (of_base, by_laser):
        assert each.drift is not None
        assert each.drift.over_scans is not None
        assert each.drift.over_scans.position == pytest.approx(0.0, abs=1e-6)
    assert by_log.drift is not None
    assert by_log.drift.over_scans is not None
    assert by_log.drift.over_scans.position > 0.01
    (unknown,) = judge(replace(office, ground_truth=None), [wheels])
    assert unknown.drift is unknown.relations is None
    with pytest.raises(MclError, match="does not overlap the log in time"):
        judge(office, [wheels], Trajectory(office.stamps + 10**15, exact.poses))


def test_relations_are_of_the_laser(office: Log):
    wheels = wheel_odometry(office)
    at_laser = compose(office.odometry, office.laser.pose)
    pairs = np.array([[0, 50], [100, 130]])
    exact = Relations(office.stamps[pairs], between(at_laser[pairs[:, 0]], at_laser[pairs[:, 1]]))
    (found,) = judge(office, [wheels], relations=exact)
    assert found.relations is not None
    assert found.relations.translation.mean == pytest.approx(0.0, abs=1e-9)
    rows = relation_table([found])
    assert rows == [(WHEELS, "0.000 ± 0.000", "0.00 ± 0.00", "0.000 ± 0.000", "0.00 ± 0.00", "2 of 2")]
    assert len(rows[0]) == len(RELATION_COLUMNS)


def test_the_table_of_drifts_has_a_row_for_each(office: Log):
    judged = judge(office, reckonings_beside(office, Config(), laser_odometry(office, Config())))
    rows = drift_table(judged)
    assert [row[0] for row in rows] == [BOTH, LASER, WHEELS]
    assert {len(row) for row in rows} == {len(DRIFT_COLUMNS)}
    assert rows[2][-1] == "-"
    json.dumps([each.to_dict() for each in judged], allow_nan=False)


def test_a_short_log_has_a_table_of_dashes(office: Log):
    short = replace(office, stamps=office.stamps[:3], odometry=office.odometry[:3], ranges=office.ranges[:3])
    (row,) = drift_table(judge(short, [wheel_odometry(short)]))
    assert row == (WHEELS, *"-" * 9)


# --- the result as a file


def test_the_file_has_the_log_as_it_was_and_the_path_beside_it(office: Log, tmp_path: Path):
    found = laser_odometry(office, Config())
    out = tmp_path / "out.mcap"
    write_mcap(out, office, found)
    again = read_log(out)
    np.testing.assert_array_equal(again.odometry, office.odometry)
    np.testing.assert_array_equal(again.ranges, office.ranges)
    assert again.metadata[schema.LASER_ODOMETRY_ABOUT]["by"] == BOTH
    assert again.grid is not None
    assert office.grid is not None
    assert again.grid.sha256 == office.grid.sha256
    chosen = read_log(out, names=Names(odom_topic=schema.LASER_ODOMETRY))
    np.testing.assert_allclose(chosen.odometry, found.poses, atol=1e-9)
    with McapFile(out) as file:
        times = [message.log_time for _, _, message in file.everything()]
        assert times == sorted(times)
        assert {topic.name: topic.count for topic in file.topics.values()}[schema.LASER_ODOMETRY] == len(office)


def test_other_readers_know_the_messages_and_their_twists(office: Log, tmp_path: Path):
    from mcap_ros2.reader import read_ros2_messages

    found = laser_odometry(office, Config())
    write_mcap(tmp_path / "out.mcap", office, found)
    messages = [m.ros_msg for m in read_ros2_messages(tmp_path / "out.mcap", topics=[schema.LASER_ODOMETRY])]
    assert len(messages) == len(office)
    assert (messages[5].header.frame_id, messages[5].child_frame_id) == ("odom", "base_link")
    step = between(found.poses[4], found.poses[5]) / ((office.stamps[5] - office.stamps[4]) / 1e9)
    twist = messages[5].twist.twist
    assert (twist.linear.x, twist.linear.y, twist.angular.z) == pytest.approx(tuple(step))
    assert messages[0].twist.twist.linear.x == 0.0


def test_an_older_laser_odometry_moves_aside(office: Log, tmp_path: Path):
    write_mcap(tmp_path / "one.mcap", office, laser_odometry(office, Config()))
    one = read_log(tmp_path / "one.mcap")
    write_mcap(tmp_path / "two.mcap", one, laser_odometry(one, Config(), alone=True))
    with McapFile(tmp_path / "two.mcap") as file:
        assert {"/laser_odom", "/recorded/laser_odom"} <= file.topics.keys()
    assert read_log(tmp_path / "two.mcap").metadata[schema.LASER_ODOMETRY_ABOUT]["by"] == LASER


# --- the command


def test_the_command_writes_what_it_is_asked_for_and_says_where(office: Log, tmp_path: Path, typed):
    tum, mcap = tmp_path / "laser.tum", tmp_path / "out.mcap"
    done = typed("odometry", office.path, "-o", tum, "--output-mcap", mcap)
    assert done.exit_code == 0, done.output
    assert done.stdout.splitlines()[-2:] == [str(tum), str(mcap)]
    assert "laser and wheels" in done.stdout
    assert "ms a scan" in done.stderr
    found = read_tum(tum)
    np.testing.assert_array_equal(found.stamps, office.stamps)
    np.testing.assert_allclose(found.poses, laser_odometry(office, Config()).poses, atol=1e-8)
    again = typed("odometry", office.path, "-o", tum)
    assert (again.exit_code, again.stderr) == (1, f"error: {tum}: this file exists already (--force replaces it)\n")


def test_the_command_judges_by_relations(office: Log, tmp_path: Path, typed):
    first, second = (f"{stamp / 1e9:.9f}" for stamp in office.stamps[[3, 40]].tolist())
    (tmp_path / "a.relations").write_text(f"{first} {second} 1 0 0 0 0 0.1\n")
    done = typed("odometry", office.path, "--relations", tmp_path / "a.relations", "--laser-alone", "--json")
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert (told["log"], told["scans"], told["by"]) == ("office", len(office), LASER)
    assert [each["odometry"] for each in told["odometries"]] == [BOTH, LASER, WHEELS]
    assert all(each["relations"]["used"] == 1 for each in told["odometries"])
    assert told["odometries"][2]["milliseconds"] is None


def test_a_configuration_may_ask_the_laser_alone(office: Log, typed, stretched):
    assert json.loads(typed("odometry", office.path, "--set", "odometry=laser", "--json").stdout)["by"] == LASER
    assert stretched.made == [("laser", False), ("both", True)]


def test_a_log_without_truth_is_told_in_a_summary(office: Log, tmp_path: Path, typed):
    from converters import convert
    from pipeline.simulate import sample_dir

    convert([sample_dir() / "office.log.gz"], tmp_path / "bare.mcap")
    done = typed("odometry", tmp_path / "bare.mcap")
    assert (done.exit_code, done.stdout) == (0, "")
    assert "laser and wheels" in done.stderr
    told = json.loads(typed("odometry", tmp_path / "bare.mcap", "--json").stdout)
    assert [each["drift"] for each in told["odometries"]] == [None]


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (("--reference", "none.tum"), "none.tum: no such file"),
        (("--relations", "none.relations"), "none.relations: no such file"),
        (("--output-mcap", "out.bag"), "the name of a log ends in .mcap"),
        (("-o", "nowhere/out.tum"), "the folder to write to does not exist"),
    ],
)
def test_what_is_wrong_is_one_line(office: Log, typed, args: tuple[str, str], said: str):
    done = typed("odometry", office.path, *args)
    assert done.exit_code == 1
    assert said in done.stderr
    assert done.stderr.count("\n") == 1


def test_the_input_is_not_overwritten(office: Log, typed):
    done = typed("odometry", office.path, "--output-mcap", office.path, "--force")
    assert (done.exit_code, "the output is the input" in done.stderr) == (1, True)
