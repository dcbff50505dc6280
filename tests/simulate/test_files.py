"""What a simulation writes as .mcap, that it is read back as it was made, and when which format is chosen."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import buildings
import numpy as np
import pytest
from mcap.reader import make_reader
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.errors import MclError
from pipeline.logs.reader import read_log
from pipeline.logs.tum import read_tum
from pipeline.maps.map_server import load_map
from pipeline.simulate import Building, Format, simulate, simulate_log
from pipeline.simulate.drive import drive
from pipeline.simulate.sensors import true_ranges
from pipeline.simulate.world import build_world, people_at
from recordings import STORE


def messages(path: Path, topic: str) -> list[Any]:
    with path.open("rb") as file:
        found = make_reader(file).iter_messages(topics=[topic])
        return [STORE.deserialize_cdr(message.data, kind.name) for kind, _, message in found if kind is not None]


@pytest.mark.parametrize(
    "building",
    [
        buildings.room(),
        buildings.turned_laser(),
        buildings.upside_down(),
        buildings.spinning(),
        buildings.dropouts(),
    ],
    ids=lambda building: building.name,
)
def test_what_is_written_is_read_back(building: Building, tmp_path: Path) -> None:
    report = simulate(building, tmp_path, 7, Format.mcap)
    made, log = simulate_log(building, 7).log, read_log(report.log)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(
        building.name + end for end in (".mcap", ".yaml", ".pgm", "_truth.tum")
    )
    assert log.stamps.tolist() == made.stamps.tolist()
    np.testing.assert_array_equal(log.ranges, made.ranges)
    np.testing.assert_allclose(log.odometry, made.odometry, atol=1e-9)
    np.testing.assert_allclose(log.laser.pose, made.laser.pose, atol=1e-9)
    np.testing.assert_allclose(log.laser.angles, made.laser.angles, atol=1e-5)  # its step is a float32
    assert (log.laser.range_min, log.laser.range_max) == (0.0, made.laser.range_max)
    assert log.ground_truth is not None
    assert made.ground_truth is not None
    np.testing.assert_allclose(log.ground_truth.poses, made.ground_truth.poses, atol=1e-9)
    assert log.grid is not None
    assert made.grid is not None
    assert log.grid.sha256 == made.grid.sha256
    assert log.metadata["mcl:source"] == made.metadata["mcl:source"]
    truth = read_tum(report.ground_truth)
    assert truth.stamps.tolist() == log.stamps.tolist()
    drawn = load_map(report.map)
    assert (drawn.resolution, drawn.occupancy.shape) == (0.05, made.grid.occupancy.shape)
    assert ((drawn.occupancy == 1.0) == (made.grid.occupancy > 0.65)).all()


def test_the_messages_say_when_beams_are_measured_and_how_fast_the_robot_turns(tmp_path: Path) -> None:
    building = buildings.spinning()
    report = simulate(building, tmp_path, 0)
    made = simulate_log(building, 0)
    assert report.format is Format.mcap
    first = messages(report.log, "/scan")[0]
    assert first.time_increment == np.float32(0.00055)
    assert first.scan_time == np.float32(0.2)
    assert first.ranges.tolist() == made.ranges[0].astype(np.float32).tolist()
    rates = [message.angular_velocity.z for message in messages(report.log, "/imu")]
    assert made.gyroscope is not None
    assert rates == made.gyroscope.rates.tolist()
    (static,) = messages(report.log, "/tf_static")
    assert [transform.child_frame_id for transform in static.transforms] == ["laser", "imu"]


def test_a_laser_upside_down_is_one_in_its_transform(tmp_path: Path) -> None:
    report = simulate(buildings.upside_down(), tmp_path, 0)
    (mount,) = messages(report.log, "/tf_static")[0].transforms
    turn = mount.transform.rotation
    up = 1.0 - 2.0 * (turn.x**2 + turn.y**2)
    assert up == pytest.approx(-1.0)
    scan = messages(report.log, "/scan")[0]
    assert (scan.angle_min, scan.angle_max) == pytest.approx((-2.356, 2.356), abs=1e-3)
    assert scan.angle_increment > 0.0


def test_the_same_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    first, second = (simulate(buildings.spinning(), tmp_path / name, 3).log for name in ("a", "b"))
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize(
    ("parts", "reason"),
    [
        ({"laser": {"beams": 181}}, "181 beams"),
        ({"laser": {"field_of_view_deg": 90}}, "another field of view"),
        ({"laser": {"pose": [0.25, 0, 90]}}, "a laser at [0.25, 0.0, 90.0], not at [0.25, 0.0, 0.0]"),
        ({"laser": {"upside_down": True}}, "upside down"),
        ({"laser": {"time_increment": 0.0001}}, "a time_increment"),
        ({"laser": {"invalid": 0.1}}, "invalid readings"),
        ({"imu": {}}, "a gyroscope"),
    ],
)
def test_the_raw_format_refuses_what_it_cannot_hold(parts: dict[str, Any], reason: str, tmp_path: Path) -> None:
    building = buildings.room(**parts)
    with pytest.raises(MclError) as caught:
        simulate(building, tmp_path / "out", 0, Format.cmu)
    said = str(caught.value)
    assert reason in said
    assert "use --format mcap" in said
    assert "\n" not in said
    assert not (tmp_path / "out").exists()
    assert simulate(building, tmp_path / "out", 0).log.suffix == ".mcap"


def test_without_such_things_it_is_the_raw_format(tmp_path: Path) -> None:
    report = simulate(buildings.room(laser={"rate": 40, "max_range": 10}), tmp_path, 0)
    assert report.format is Format.cmu
    assert sorted(path.name for path in tmp_path.iterdir()) == ["room.dat.gz", "room.log.gz", "room_truth.tum"]


def test_the_command_writes_either_and_never_over_its_input(tmp_path: Path) -> None:
    # Every YAML is made of JSON, or the other way round.
    source = tmp_path / "room.yaml"
    source.write_text(json.dumps(buildings.room().model_dump(exclude_none=True)))
    run = CliRunner().invoke
    done = run(app, ["simulate", str(source), "-o", str(tmp_path / "raw")])
    assert done.exit_code == 0, done.output
    assert done.stdout.splitlines() == [
        str(tmp_path / "raw" / f"room{e}") for e in (".log.gz", ".dat.gz", "_truth.tum")
    ]
    done = run(app, ["simulate", str(source), "-o", str(tmp_path / "ros"), "--format", "mcap"])
    assert done.exit_code == 0, done.output
    names = [f"room{end}" for end in (".mcap", ".yaml", ".pgm", "_truth.tum")]
    assert done.stdout.splitlines() == [str(tmp_path / "ros" / name) for name in names]
    before = source.read_bytes()
    done = run(app, ["simulate", str(source), "-o", str(tmp_path), "--format", "mcap", "--force"])
    assert done.exit_code == 1
    assert "the output is the input" in done.output
    assert source.read_bytes() == before


@pytest.mark.parametrize("name", buildings.DESCRIBED)
def test_the_robots_of_the_described_buildings_touch_nothing(name: str) -> None:
    building = buildings.described(name)
    world, motion = build_world(building, mapped=False), drive(building.robot)
    all_round = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    seen = np.ones((36, len(world.panes)), dtype=np.bool_)
    for time, pose in zip(motion.times[::10], motion.poses[::10], strict=True):
        free = true_ranges(world, people_at(building.people, time), pose[:2], all_round, seen).min()
        assert free > building.robot.radius, f"at {time:.1f} s the robot is {free:.2f} m from something"


def test_the_described_buildings_are_of_three_kinds() -> None:
    made = [buildings.described(name) for name in buildings.DESCRIBED]
    assert [(b.laser.beams, b.laser.rate, b.laser.field_of_view_deg) for b in made] == [
        (541, 15.0, 270.0),
        (360, 5.0, 360.0),
        (181, 40.0, 180.0),
    ]
    assert all(building.map.resolution == 0.05 for building in made)
    for building in made:
        assert 60.0 < drive(building.robot).times[-1] < 120.0
        assert any(leg.backwards for leg in building.robot.legs)
        assert any(leg.pause for leg in building.robot.legs)
        assert any(leg.turn_deg for leg in building.robot.legs)
