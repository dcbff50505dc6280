"""Drift of dead reckoning, on drives small enough to work out by hand."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import MclError
from pipeline.evaluate.drift import (
    Relations,
    drift,
    driven,
    over_scans,
    per_metre,
    read_relations,
    relation_errors,
)
from pipeline.evaluate.metrics import interpolate
from pipeline.geometry import compose
from pipeline.logs.tum import read_tum

SECOND = 1_000_000_000


def drive(scans: int, step: tuple[float, float, float]) -> np.ndarray:
    """Poses of a robot that takes the same step again and again, from (3, -2, 1) on."""
    poses = [np.array([3.0, -2.0, 1.0])]
    for _ in range(scans - 1):
        poses.append(compose(poses[-1], step))
    return np.array(poses)


# --- over scans


def test_wheels_that_count_a_tenth_too_much_are_a_tenth_of_the_way_off():
    found = over_scans(drive(31, (0.11, 0, 0)), drive(31, (0.1, 0, 0)), scans=10)
    assert found is not None
    assert (found.scans, found.windows) == (10, 3)
    assert found.position == pytest.approx(0.1)
    assert found.heading == pytest.approx(0.0, abs=1e-9)


def test_a_heading_that_creeps_away_is_told_in_degrees():
    found = over_scans(drive(31, (0, 0, np.radians(0.5))), drive(31, (0, 0, 0)), scans=10)
    assert found is not None
    assert (found.position, found.heading) == (pytest.approx(0, abs=1e-9), pytest.approx(5.0))


def test_the_frames_of_the_two_do_not_matter():
    poses, truth = drive(31, (0.1, 0, 0.05)), drive(31, (0.1, 0.01, 0.04))
    elsewhere = compose((7.0, 1.0, -2.5), poses)
    found, told = over_scans(elsewhere, truth, 10), over_scans(poses, truth, 10)
    assert found is not None
    assert told is not None
    assert (found.position, found.heading) == pytest.approx((told.position, told.heading))


def test_windows_lie_end_to_end_or_begin_at_every_scan():
    poses, truth = drive(31, (0.1, 0, 0)), drive(31, (0.1, 0, 0))
    poses[15:, 0] += 1.0  # one leap, which only the second of three windows sees
    end_to_end, everywhere = over_scans(poses, truth, 10), over_scans(poses, truth, 10, stride=1)
    assert end_to_end is not None
    assert everywhere is not None
    assert (end_to_end.windows, everywhere.windows) == (3, 21)
    assert end_to_end.position == pytest.approx(0.0, abs=1e-9)


def test_scans_without_truth_and_logs_that_are_too_short_have_no_windows():
    poses = drive(31, (0.1, 0, 0))
    truth = poses.copy()
    truth[:12] = np.nan
    found = over_scans(poses, truth, 10)
    assert found is not None
    assert found.windows == 1
    assert over_scans(poses[:10], poses[:10], 10) is None
    assert over_scans(poses, np.full_like(poses, np.nan), 10) is None


# --- per metre


def test_drift_per_metre_is_the_same_over_any_length():
    truth = drive(400, (0.1, 0, 0))
    found = per_metre(drive(400, (0.102, 0, 0)), truth, lengths=(1.0, 5.0))
    assert [(each.length, each.position) for each in found if each] == [
        (1.0, pytest.approx(2.0, rel=1e-6)),
        (5.0, pytest.approx(2.0, rel=1e-6)),
    ]


def test_turning_drifts_in_degrees_per_metre():
    truth = drive(400, (0.1, 0, 0))
    poses = truth + np.radians(0.03) * np.arange(400)[:, None] * [0, 0, 1]
    (found,) = per_metre(poses, truth, lengths=(5.0,))
    assert found is not None
    assert found.heading == pytest.approx(0.3)


def test_a_robot_that_stands_and_trembles_drives_nothing():
    truth = np.zeros((500, 3))
    truth[:, :2] = np.random.default_rng(1).normal(0, 0.01, (500, 2))
    assert driven(truth)[-1] == 0.0
    assert per_metre(truth, truth, lengths=(1.0,)) == (None,)


def test_what_is_driven_goes_on_over_scans_without_truth():
    truth = drive(21, (0.1000001, 0, 0))
    truth[5:10] = np.nan
    path = driven(truth)
    assert path[[4, 9]].tolist() == pytest.approx([0.4, 0.4], abs=1e-5)
    assert path[[10, 20]].tolist() == pytest.approx([1.0, 2.0], abs=1e-5)


def test_a_drift_is_ready_for_json():
    poses = drive(250, (0.1, 0, 0.01))
    plain = drift(poses, poses).to_dict()
    assert json.loads(json.dumps(plain, allow_nan=False))["over_scans"]["windows"] == 1
    assert [each["length"] for each in plain["per_metre"]] == [1.0, 5.0, 10.0]
    assert drift(poses[:2], poses[:2]).to_dict() == {"over_scans": None, "per_metre": (None, None, None)}


# --- relations


def made_up() -> tuple[np.ndarray, np.ndarray, Relations]:
    """Five scans a second apart, a metre each, and three relations: off by nothing, by 0.3 m, by 10 degrees."""
    stamps = 1_700_000_000 * SECOND + np.arange(5, dtype=np.int64) * SECOND
    poses = drive(5, (1.0, 0, np.pi / 2))
    motions = np.array([[1.0, 0, np.pi / 2], [1.0, 1.3, np.pi], [1.0, 0, np.pi / 2 - np.radians(10)]])
    pairs = np.stack([stamps[[0, 1, 3]], stamps[[1, 3, 4]]], axis=1)
    return stamps, poses, Relations(pairs, motions)


def test_errors_in_relations_are_means_with_their_spread():
    found = relation_errors(*made_up())
    assert (found.used, found.total) == (3, 3)
    assert (found.translation.mean, found.translation.std) == (pytest.approx(0.1), pytest.approx(0.1 * np.sqrt(2)))
    assert found.squared_translation.mean == pytest.approx(0.03)
    assert found.rotation.mean == pytest.approx(10 / 3)
    assert found.squared_rotation.mean == pytest.approx(100 / 3)
    json.dumps(found.to_dict(), allow_nan=False)


def test_the_order_of_a_relations_scans_is_its_own():
    stamps, poses, _ = made_up()
    back = np.array([[stamps[1], stamps[0]]])
    found = relation_errors(stamps, poses, Relations(back, np.array([[0.0, 1.0, -np.pi / 2]])))
    assert found.translation.mean == pytest.approx(0.0, abs=1e-9)


def test_relations_of_scans_that_the_log_lacks_are_left_out_and_counted():
    stamps, poses, relations = made_up()
    moved = relations.stamps.copy()
    moved[0, 0] -= SECOND // 2
    moved[1] += 900_000  # less than a millisecond
    found = relation_errors(stamps, poses, Relations(moved, relations.motions))
    assert (found.used, found.total) == (2, 3)
    with pytest.raises(MclError, match="none of the relations"):
        relation_errors(stamps, poses, Relations(moved + 100 * SECOND, relations.motions))


def test_relations_are_read_to_the_nanosecond(tmp_path: Path):
    file = tmp_path / "a.relations"
    file.write_text("# by hand\n976052905.167303 976052911.885496 -0.05 -0.12 0.9 0.1 0.2 -1.68\n\n")
    found = read_relations(file)
    assert found.stamps.tolist() == [[976052905_167303000, 976052911_885496000]]
    assert found.motions.tolist() == [[-0.05, -0.12, -1.68]]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 2 0 0 0 0 0 0\n1 2 3\n", r"a\.relations:2: expected 8 numbers .*found 3"),
        ("1 2 0 0 0 0 0 far\n", r"a\.relations:1: not a number"),
        ("soon 2 0 0 0 0 0 0\n", r"a\.relations:1: not a number"),
        ("1 2 nan 0 0 0 0 0\n", r"a\.relations:1: NaN or an infinite number"),
        ("# nothing\n", r"a\.relations: no relations in this file"),
    ],
)
def test_what_is_wrong_with_relations_is_one_line(tmp_path: Path, text: str, said: str):
    file = tmp_path / "a.relations"
    file.write_text(text)
    with pytest.raises(MclError, match=said) as caught:
        read_relations(file)
    assert "\n" not in str(caught.value)


def test_relations_that_are_no_text_or_not_there(tmp_path: Path):
    with pytest.raises(MclError, match="no such file"):
        read_relations(tmp_path / "none.relations")
    (tmp_path / "a.relations").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(MclError, match="not a text file"):
        read_relations(tmp_path / "a.relations")


# --- real drives


def test_the_wheels_of_a_real_robot(shared_data: Path, tmp_path: Path):
    from converters import convert
    from pipeline.logs.reader import read_log

    folder = shared_data / "carmen" / "fr079"
    convert([folder / "fr079.log.gz"], tmp_path / "fr079.mcap")
    log = read_log(tmp_path / "fr079.mcap")
    found = over_scans(log.odometry, interpolate(read_tum(folder / "groundtruth.tum"), log.stamps))
    assert found is not None
    assert (found.position, found.heading) == (pytest.approx(1.28, abs=0.005), pytest.approx(16.3, abs=0.05))
    errors = relation_errors(
        log.stamps,
        interpolate(read_tum(folder / "groundtruth.tum"), log.stamps),
        read_relations(folder / "fr079.relations"),
    )
    assert (errors.used, errors.total) == (1685, 1685)
    assert errors.translation.mean == pytest.approx(0.036, abs=0.0005)
