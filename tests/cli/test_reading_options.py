"""What is said on the command line of how to read a log, in every command that reads one, and what is said back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from drives import FRAMES, drive, looped, moments, ordinary_drive, scan
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.maps.map_server import save_map
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.simulate import sample_dir
from recordings import Recording

FEW = ("--particles", "50", "--pose", "2,2,0", "--no-record")
MAP = ("--map", str(sample_dir() / "office.dat.gz"))
OPTIONS = (
    "--scan-topic",
    "--odom-topic",
    "--base-frame",
    "--odom-frame",
    "--laser-frame",
    "--laser-pose",
    "--tf",
    "--stamps",
)


def mcl(*typed: object, code: int = 0) -> tuple[str, str]:
    done = CliRunner().invoke(app, [str(word) for word in typed])
    assert done.exit_code == code, done.output
    return done.stdout, done.stderr


@pytest.mark.parametrize("command", ["convert", "check", "localize", "evaluate", "tune", "odometry", "view"])
def test_every_command_that_reads_a_log_has_the_same_options(command: str) -> None:
    shown, _ = mcl(command, "--help")
    assert [option for option in OPTIONS if option not in shown] == []


def other_clock() -> Recording:
    recording = Recording()
    for recording, moment in drive():
        recording.odometry(moment.stamp - 10**16, *moment.pose, topic="/odom", frames=FRAMES)
        topic, kind, _, sequence, data = recording.entries[-1]
        recording.entries[-1] = (topic, kind, moment.stamp, sequence, data)
        scan(recording, moment)
    return recording


def test_stamps_and_the_lasers_place(tmp_path: Path) -> None:
    path = other_clock().write(tmp_path / "a.mcap")
    assert "--stamps log" in mcl("odometry", path, code=1)[1]
    mcl("odometry", path, "--stamps", "log", "--laser-pose", "0.3,0,0", "-o", tmp_path / "way.tum")
    assert len((tmp_path / "way.tum").read_text().splitlines()) == len(moments())
    assert "is not X,Y,YAW" in mcl("odometry", path, "--laser-pose", "0.3,nan,0", code=2)[1]


def raw(tmp_path: Path) -> dict[str, Path]:
    """The same drive as everything that `mcl convert` takes."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    found = {"mcap": ordinary_drive().write(tmp_path / "drive.mcap")}
    for plugin in (StoragePlugin.SQLITE3, StoragePlugin.MCAP):
        folder = tmp_path / plugin.name.lower()
        with Writer(folder, version=9, storage_plugin=plugin) as writer:
            topics = {}
            for topic, kind, stamp, _, data in ordinary_drive().entries:
                if topic not in topics:
                    topics[topic] = writer.add_connection(topic, kind, typestore=store)
                writer.write(topics[topic], stamp, data)
        found[f"folder of {folder.name}"] = folder
    found["db3"] = next((tmp_path / "sqlite3").glob("*.db3"))
    return found


def test_whatever_convert_takes_is_taken_and_gives_the_same(tmp_path: Path) -> None:
    said = {}
    for kind, path in raw(tmp_path).items():
        out = tmp_path / f"{kind}.tum"
        _, err = mcl("odometry", path, "-o", out)
        said[kind] = out.read_text()
        assert ("read as a ROS bag, by way of" in err) == (kind != "mcap")
    assert len(set(said.values())) == 1


def test_a_raw_log_is_converted_once(tmp_path: Path) -> None:
    def way() -> Path:
        _, err = mcl("odometry", sample_dir() / "office.log.gz")
        return Path(next(line for line in err.splitlines() if "by way of" in line).rpartition(" ")[2])

    first = way()
    made = first.stat().st_ino
    assert way().stat().st_ino == made
    first.write_bytes(first.read_bytes()[:5000])  # whoever was killed while writing it
    assert way().stat().st_ino != made
    assert first.stat().st_size > 100_000


def test_what_was_left_out_and_chosen_is_said_in_lines(tmp_path: Path) -> None:
    _, err = mcl("localize", looped(2, False).write(tmp_path / "a.mcap"), *MAP, *FEW, "-o", tmp_path / "run")
    (line,) = [line for line in err.splitlines() if line.startswith("note: ") and "a.mcap" in line]
    assert "the stamps of /scan run back by" in line
    assert (tmp_path / "run" / "trajectory.tum").read_text().count("\n") == 120
    assert "nan" not in (tmp_path / "run" / "trajectory.tum").read_text()
    typed = ("localize", tmp_path / "a.mcap", *MAP, *FEW, "--output-mcap", tmp_path / "b.mcap", "-o", tmp_path / "c")
    assert "its messages have other stamps (mcl convert makes" in mcl(*typed, code=1)[1]


def test_a_map_of_another_machine_is_said(tmp_path: Path) -> None:
    grid = OccupancyGrid(np.zeros((30, 30), np.float32), 0.5)
    yaml, _ = save_map(grid, tmp_path / "m.yaml")
    yaml.write_text(yaml.read_text().replace("m.pgm", "/robots/theirs/m.pgm"))
    path = ordinary_drive().write(tmp_path / "a.mcap")
    _, err = mcl("localize", path, "--map", yaml, *FEW, "-o", tmp_path / "run")
    assert "m.yaml: image: /robots/theirs/m.pgm is not there; m.pgm beside the YAML is taken" in err
