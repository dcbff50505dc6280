"""Logs converted with faults: what is read back is what the same faults make of the log in memory."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from converters import convert
from converters.cmu import export_raw
from pipeline.cli import app
from pipeline.errors import MclError
from pipeline.geometry import between, wrap_angle
from pipeline.logs import schema
from pipeline.logs.disturbed import disturbed
from pipeline.logs.faults import noted, parse_fault, placed
from pipeline.logs.messages import Log
from pipeline.logs.reader import read_log
from pipeline.simulate import sample_dir
from recordings import ordinary

CARMEN = "\n".join(f"FLASER 4 1 2 3 {4 + i} {0.2 + 0.1 * i} 0 0 {0.1 * i} 0 0 {100 + i}.5 host 0.5" for i in range(60))
EVERY = ["gap:40:60", "carried:40:60", "turn:40.05:90", "slide:40.05:1:0.5", "spin:40:42", "dead:40:60", "mirrored",
         "no-reverse", "scale:0.7", "restart:40.05", "late:0.3", "thin:2", "turn", "gap"]  # fmt: skip


def office(path: Path, *faults: str, seed: int = 0) -> Log:
    sample = sample_dir()
    convert(
        [sample / "office.log.gz"],
        path,
        map_path=sample / "office.dat.gz",
        ground_truth=sample / "office_truth.tum",
        faults=[parse_fault(text) for text in faults],
        seed=seed,
    )
    return read_log(path)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Log:
    return office(tmp_path_factory.mktemp("plain") / "office.mcap")


@pytest.mark.parametrize("text", EVERY)
def test_a_converted_fault_is_that_of_the_log_in_memory(plain: Log, tmp_path: Path, text: str) -> None:
    """But for what happens between two scans, which the wheels' own readings tell more finely."""
    log = office(tmp_path / "office.mcap", text, seed=4)
    made, rows = disturbed(plain, placed([parse_fault(text)], plain.duration, 4))
    np.testing.assert_array_equal(log.stamps, made.stamps)
    np.testing.assert_array_equal(log.ranges, plain.ranges[rows])
    exactly = ("gap", "slide", "mirrored", "thin")
    tolerance = 1e-6 if text.partition(":")[0] in exactly else 0.2  # m, rad: less than a scan apart
    steps = between(log.odometry[:-1], log.odometry[1:])
    expected = between(made.odometry[:-1], made.odometry[1:])
    difference = steps - expected
    difference[:, 2] = wrap_angle(difference[:, 2])
    np.testing.assert_allclose(difference, 0.0, atol=tolerance)
    assert log.ground_truth is not None
    assert plain.ground_truth is not None
    np.testing.assert_array_equal(log.ground_truth.poses, plain.ground_truth.poses)
    np.testing.assert_array_equal(log.ground_truth.stamps, plain.ground_truth.stamps)
    assert noted(log.metadata) == noted(made.metadata)


def test_carried_is_what_is_dropped(plain: Log, tmp_path: Path) -> None:
    """``--drop`` counts from the first line, and can give the raw log back; else they are the same."""
    sample = sample_dir()
    first = float(plain.stamps[0]) / 1e9  # the first line is at 0 s
    convert([sample / "office.log.gz"], tmp_path / "dropped.mcap", drop=[(40.0 + first, 60.0 + first)])
    dropped, carried = read_log(tmp_path / "dropped.mcap"), office(tmp_path / "carried.mcap", "carried:40:60")
    np.testing.assert_array_equal(dropped.stamps, carried.stamps)
    np.testing.assert_allclose(dropped.odometry, carried.odometry, atol=1e-6)
    assert json.loads(carried.metadata[schema.FAULTS]["kidnapped_at"]) == [60.0]


def test_another_seed_places_faults_elsewhere(tmp_path: Path) -> None:
    one, same, other = (office(tmp_path / f"{k}.mcap", "turn", seed=seed) for k, seed in enumerate((1, 1, 2)))
    assert noted(one.metadata) == noted(same.metadata) != noted(other.metadata)
    assert one.sha256 == same.sha256


def test_without_faults_nothing_is_noted(plain: Log) -> None:
    assert schema.FAULTS not in plain.metadata


def test_a_log_with_faults_has_no_raw_log_to_give_back(tmp_path: Path) -> None:
    office(tmp_path / "office.mcap", "mirrored")
    with pytest.raises(MclError, match="made with faults: there is no raw log"):
        export_raw(tmp_path / "office.mcap", tmp_path / "raw.log")


def test_carmen_logs_and_bags_have_faults_too(tmp_path: Path) -> None:
    raw = tmp_path / "carmen.log"
    raw.write_text(CARMEN + "\n")
    report = convert([raw], tmp_path / "carmen.mcap", faults=[parse_fault("scale:0.5"), parse_fault("gap:20:25.2")])
    assert (report.faults, report.scans, report.odometry) == (["scale:0.5", "gap:20:25.2"], 54, 54)
    log = read_log(tmp_path / "carmen.mcap")
    driven = np.hypot(*np.diff(log.odometry[:, :2], axis=0).T)
    assert driven[:19] == pytest.approx(0.05, abs=1e-6)
    assert driven[19] == pytest.approx(7 * 0.05, abs=1e-6)

    bag = ordinary().write(tmp_path / "bag.mcap")
    convert([bag], tmp_path / "plain.mcap")
    report = convert([bag], tmp_path / "thin.mcap", faults=[parse_fault("thin:0.35")])
    whole, thin = read_log(tmp_path / "plain.mcap"), read_log(tmp_path / "thin.mcap")
    assert report.scans == len(thin) < len(whole)
    assert np.diff(thin.times).min() >= 0.35
    assert set(thin.stamps.tolist()) < set(whole.stamps.tolist())


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (("--fault", "truning"), "no kind of fault 'truning'"),
        (("--fault", "jump:3:30"), "only mcl evaluate can make it"),
        (("--fault", "turn:500"), "the log runs from 0 to"),
        (("--fault", "mirrored", "--without-odometry"), "fault mirrored: the log has no odometry"),
    ],
)
def test_what_cannot_be_made_is_one_line(tmp_path: Path, asked: tuple[str, ...], said: str) -> None:
    source = sample_dir() / "office.log.gz"
    done = CliRunner().invoke(app, ["convert", str(source), "-o", str(tmp_path / "new.mcap"), *asked])
    assert done.exit_code == 1
    assert said in done.output
    assert not (tmp_path / "new.mcap").exists()
