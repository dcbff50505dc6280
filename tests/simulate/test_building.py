"""Descriptions of buildings: what is accepted, and what is said about what is not."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.errors import MclError
from pipeline.simulate import load_building

GOOD = """\
name: hut
map: {size: [8, 6]}
rooms:
  - {name: hall, box: [1, 1, 7, 5]}
doors:
  - {start: [3, 1], end: [4, 1], open_deg: 45}
robot:
  start: [2, 2]
  legs:
    - {to: [6, 4]}
"""


def load(tmp_path: Path, text: str):
    path = tmp_path / "hut.yaml"
    path.write_text(text)
    return load_building(path)


def test_values_and_defaults_are_read(tmp_path: Path) -> None:
    building = load(tmp_path, GOOD)
    assert building.rooms[0].box == (1.0, 1.0, 7.0, 5.0)
    assert building.doors[0].open_deg == 45.0
    assert building.doors[0].mapped_open_deg is None
    assert building.robot.legs[0].to == (6.0, 4.0)
    assert building.laser.rate == 5.0
    assert building.laser.beams == 180
    assert building.imu is None


@pytest.mark.parametrize(
    ("good", "bad", "line", "said"),
    [
        ("rooms:", "romos:", 3, "'rooms'"),
        ("open_deg", "open_degs", 6, "'open_deg'"),
        ("box:", "bocks:", 4, "unknown key 'rooms[0].bocks'"),
        ("{to: [6, 4]}", "{too: [6, 4]}", 10, "'to'"),
        ("{to: [6, 4]}", "{to: [6, 4], pause: 1}", 10, "one of to"),
        ("[1, 1, 7, 5]", "[7, 1, 1, 5]", 4, "x_min < x_max"),
        ("open_deg: 45", "open_deg: wide", 6, "'wide'"),
        ("end: [4, 1]", "end: [3, 1]", 6, "two points"),
        ("start: [2, 2]", "start: [2]", 8, "robot.start"),
    ],
)
def test_mistakes_are_told_with_their_line(tmp_path: Path, good: str, bad: str, line: int, said: str) -> None:
    with pytest.raises(MclError) as caught:
        load(tmp_path, GOOD.replace(good, bad))
    assert caught.value.line == line
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ("laser: {beams: 0}", "laser.beams: expected a number of at least 2, got 0"),
        ("laser: {beams: 180.5}", "laser.beams: expected a whole number"),
        (
            "laser: {field_of_view_deg: 400}",
            "laser.field_of_view_deg: expected a number of at most 360, got 400",
        ),
        ("laser: {field_of_view: 270}", "unknown key 'laser.field_of_view' (did you mean 'field_of_view_deg'?)"),
        ("laser: {pose: [0.2, 0]}", "laser.pose"),
        ("laser: {upside_down: perhaps}", "laser.upside_down"),
        ("laser: {rate: 0}", "laser.rate: expected a number above 0, got 0"),
        ("laser: {time_increment: -0.001}", "laser.time_increment: expected a number of at least 0"),
        ("laser: {time_increment: 0.01}", "a scan take 1.79 s, longer than from scan to scan (0.2 s)"),
        ("laser: {invalid: 2}", "laser.invalid"),
        ("imu: {rate: 0}", "imu.rate: expected a number above 0, got 0"),
        ("imu: {noise: -1}", "imu.noise"),
        ("imu: {bais: 1}", "unknown key 'imu.bais' (did you mean 'bias'?)"),
    ],
)
def test_mistakes_in_sensors_are_told_in_one_line(tmp_path: Path, section: str, said: str) -> None:
    with pytest.raises(MclError) as caught:
        load(tmp_path, f"{GOOD}{section}\n")
    assert caught.value.line == 11
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[1, 2]", "mapping"),
        ("rooms: [", "hut.yaml:"),
        ("", "mapping"),
        (GOOD.replace("[6, 4]", "[60, 4]"), "outside the map"),
        (GOOD.replace("name: hut", "name: ../hut"), "name"),
        (GOOD.replace("  - {name: hall, box: [1, 1, 7, 5]}", "  []"), "rooms or walls"),
        (GOOD.replace("[8, 6]", "[8, .nan]"), "map.size"),
    ],
)
def test_files_that_describe_no_building(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(MclError, match=r"hut\.yaml") as caught:
        load(tmp_path, text)
    assert said in str(caught.value)


def test_a_missing_file_and_one_that_is_not_text(tmp_path: Path) -> None:
    with pytest.raises(MclError, match="No such file"):
        load_building(tmp_path / "none.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(MclError, match="not a text file"):
        load_building(tmp_path / "binary.yaml")
