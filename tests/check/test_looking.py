"""A look at a log names what is wrong with it, and says nothing of a sound one."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from buildings import described
from drives import ordinary_drive

from converters import convert
from pipeline.check.findings import ADVICE, GRADES, Finding, of_remark, worst_first
from pipeline.check.laser import findings_of_laser, findings_of_limits
from pipeline.check.looking import at_a_glance, look
from pipeline.check.map import findings_of_map, place
from pipeline.check.odometry import ADVICE as OF_FAULTS
from pipeline.check.odometry import hear
from pipeline.check.recording import findings_of_times
from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.logs.faults import parse_fault
from pipeline.logs.messages import Log
from pipeline.logs.reader import read_log
from pipeline.motion.faults import KINDS
from pipeline.simulate import sample_dir
from pipeline.simulate.mapping import draw_map
from pipeline.simulate.world import build_world
from recordings import UPRIGHT, Recording

ROOT = Path(__file__).resolve().parents[2]
QUICK = Config(max_particles=4000)


def said(findings: object, grade: str = "") -> str:
    return " ".join(f.text for f in findings if f.grade == grade or not grade)  # type: ignore[attr-defined]


def disturbed(fault: str, folder: Path) -> Log:
    sample = sample_dir()
    path = folder / "disturbed.mcap"
    convert([sample / "office.log.gz"], path, map_path=sample / "office.dat.gz", faults=[parse_fault(fault)], seed=1)
    return read_log(path)


def test_nothing_is_found_in_a_sound_log(office: Log) -> None:
    report = look(office.path, QUICK)
    assert [finding for finding in report.findings if finding.grade != "noted"] == []
    assert dict(report.facts)["laser"].startswith("180 beams over 179 deg")
    (scans,) = (topic for topic in report.topics if topic.name == "/scan")
    assert scans.rate == pytest.approx(5.0, rel=0.05)


@pytest.mark.parametrize(
    ("fault", "grade", "words"),
    [
        ("mirrored", "broken", r"turns are mirrored"),
        ("scale:0.7", "doubtful", r"say 0\.\d\d m for every metre"),
        ("dead:5", "broken", r"From [4-9]\.\d s to the end.*the wheels say nothing"),
        ("slide:30:0.9:0", "noted", r"slipped at 30\.\d s"),
        ("restart:40", "doubtful", r"leapt at 40\.\d s.*restarted from zero"),
    ],
)
def test_a_fault_of_the_wheels_is_named(fault: str, grade: str, words: str, tmp_path: Path) -> None:
    found = hear(disturbed(fault, tmp_path), QUICK).findings
    assert re.search(words, said(found, grade)), found


def test_every_fault_of_the_wheels_has_advice() -> None:
    assert set(OF_FAULTS) == set(KINDS)


def test_a_gap_is_told_with_its_times(tmp_path: Path) -> None:
    (gap,) = findings_of_times(disturbed("carried:40:60", tmp_path))
    assert gap.span == pytest.approx((40.0, 60.0), abs=0.5)
    assert "stood still" in gap.text


def test_scans_that_are_mirrored_are_found_by_trying(office: Log) -> None:
    laser = dataclasses.replace(office.laser, angle_min=-float(office.laser.angles[-1]))
    wrong = dataclasses.replace(office, laser=laser, ranges=np.ascontiguousarray(office.ranges[:, ::-1]), sweeps=None)
    (finding,) = place(wrong, Config()).findings
    assert (finding.grade, finding.about) == ("broken", "laser")
    assert "mirrored" in finding.text


def test_a_laser_that_is_turned_on_its_mount_is_told_by_the_wheels(office: Log) -> None:
    x, y, yaw = office.laser.pose
    turned = dataclasses.replace(office.laser, pose=(x, y, yaw + np.pi / 2))
    found = hear(dataclasses.replace(office, laser=turned), QUICK).findings
    assert re.search(r"drive (8|9|10)\d deg left of where the wheels say", said(found, "broken"))


def test_the_map_of_another_building_is_named(office: Log) -> None:
    other = draw_map(described("apartment"), build_world(described("apartment"), mapped=True), np.random.default_rng(0))
    tried = place(dataclasses.replace(office, grid=other), QUICK)
    assert "No place in the map explains the scans" in said(tried.findings)


def test_a_robot_that_is_not_found_is_told_however_much_the_map_explains(
    office: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    def localized(log: Log, *_: object, **__: object) -> SimpleNamespace:
        return SimpleNamespace(explained=np.full(len(log), 0.7), verdicts=(verdict,) * len(log))

    monkeypatch.setattr("pipeline.check.map.localize", localized)
    monkeypatch.setattr("pipeline.mirrored.localize", localized)
    verdict = "ambiguous"
    assert "not found in the map" in said(place(office, QUICK).findings, "doubtful")
    verdict = "off the map"
    assert place(office, QUICK).findings == ()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"max_particles": 1}, "each of the"),
        ({"init": "map", "max_particles": 100}, "each of the"),
        ({"init": "pose", "initial_pose": (1e4, 0, 0)}, "no free floor"),
        ({"occupied_threshold": 1.0, "free_threshold": 0.0}, "no robot can stand"),
        ({"laser_max_range": 1.0}, r"laser_max_range = 1 m cuts \d+ %"),
        ({"laser_min_range": 3.0}, r"laser_min_range = 3 m leaves out \d+ %"),
        ({"laser_min_range": 3.0, "laser_max_range": 2.0}, "the longest range that counts 2 m"),
    ],
)
def test_parameters_are_held_against_log_and_map(change: dict[str, object], words: str, office: Log) -> None:
    assert not [f for f in at_a_glance(office, Config()) if f.grade != "noted"]
    config = Config.model_validate(change)
    assert re.search(words, said([*findings_of_map(office, config), *findings_of_limits(office, config)]))


def test_a_laser_that_sees_the_robot_or_hangs_or_is_blind_is_doubted(office: Log) -> None:
    ranges = office.ranges.copy()
    ranges[:, :20] = np.float32(0.3)
    ranges[:, 20:30] = np.nan
    assert "see the robot itself" in said(findings_of_laser(dataclasses.replace(office, ranges=ranges)))
    assert "6 % of the beams never" in said(findings_of_laser(dataclasses.replace(office, ranges=ranges)))
    ranges = office.ranges.copy()
    ranges[200:300] = ranges[200]
    assert "the laser hangs" in said(findings_of_laser(dataclasses.replace(office, ranges=ranges)))
    blind = dataclasses.replace(office, ranges=np.full_like(office.ranges, np.nan))
    assert "No beam of any scan" in said(findings_of_laser(blind), "broken")
    wide = dataclasses.replace(office.laser, angle_increment=0.1)
    assert "more than a full turn" in said(findings_of_laser(dataclasses.replace(office, laser=wide)), "broken")


def test_angles_that_contradict_the_number_of_ranges_are_broken(tmp_path: Path) -> None:
    recording = Recording()
    recording.transforms(("base_footprint", "hokuyo_link", (0.2, 0.0, 0.3), UPRIGHT))
    for k in range(40):
        recording.odometry(k * 10**8, 0.1 * k, 0.0, 0.0)
        recording.scan(k * 10**8, [1.0 + 0.01 * k] * 30, step=0.1)
    entries = []
    for topic, kind, stamp, sequence, data in recording.entries:
        if kind.endswith("LaserScan"):  # angle_max stands behind the header and angle_min
            at = data.index(np.float32(-0.5).tobytes()) + 4
            data = data[:at] + np.float32(9.0).tobytes() + data[at + 4 :]
        entries.append((topic, kind, stamp, sequence, data))
    recording.entries = entries
    path = recording.write(tmp_path / "odd.mcap")
    report = look(path, QUICK)
    assert "would be 96 ranges, and the scans have 30" in said(report.findings, "broken")


def test_a_recording_that_cannot_be_read_is_told_with_its_topics(tmp_path: Path) -> None:
    recording = Recording()
    for k in range(5):
        recording.odometry(k * 10**8, 0.1 * k, 0.0, 0.0)
    report = look(recording.write(tmp_path / "no_laser.mcap"), QUICK)
    assert report.findings[0].grade == "broken"
    assert "no laser scans" in report.findings[0].text
    assert [topic.name for topic in report.topics] == ["/robot/odometry"]


def test_wheels_with_a_clock_of_their_own_are_told(tmp_path: Path) -> None:
    recording = ordinary_drive()
    late = [
        (topic, kind, stamp + (800_000_000 if kind.endswith("Odometry") else 0), sequence, data)
        for topic, kind, stamp, sequence, data in recording.entries
    ]
    recording.entries = late
    report = look(recording.write(tmp_path / "late.mcap"), QUICK)
    assert "0.80 s behind those of" in said(report.findings, "doubtful")


def test_what_is_no_log_is_an_error_as_everywhere(tmp_path: Path) -> None:
    with pytest.raises(MclError, match="no such file"):
        look(tmp_path / "none.log", QUICK)
    (tmp_path / "letter.txt").write_text("Dear robot,\n")
    with pytest.raises(MclError, match="no known format"):
        look(tmp_path / "letter.txt", QUICK)


def test_the_worst_comes_first_and_otherwise_the_order_stays() -> None:
    found = [Finding(grade, "x", str(k), "") for k, grade in enumerate(("noted", "broken", "doubtful", "broken"))]  # type: ignore[arg-type]
    assert [f.text for f in worst_first(found)] == ["1", "3", "2", "0"]
    assert GRADES == ("broken", "doubtful", "noted")


@pytest.mark.parametrize("words", [words for words, *_ in ADVICE])
def test_the_reader_still_says_what_there_is_advice_for(words: str) -> None:
    sources = [p for folder in ("pipeline/logs", "pipeline/maps", "converters") for p in (ROOT / folder).glob("*.py")]
    joined = [re.sub(r'"\s*\n\s*f?"', "", path.read_text(encoding="utf-8")) for path in sources]
    assert any(words in text for text in joined)


def test_a_remark_without_advice_is_noted() -> None:
    assert of_remark("something new") == Finding("noted", "reading", "Something new.", "Nothing.")
