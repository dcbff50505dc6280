"""What reads files, and sound ones for each: fuzz.py mangles these."""

from __future__ import annotations

import dataclasses
import gzip
import tempfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import mangling
import numpy as np
from mcap.writer import CompressionType, Writer

from converters import convert, read_map
from pipeline import nav2
from pipeline.check.amcl_file import checked, findings_of_file
from pipeline.check.looking import at_a_glance
from pipeline.config import Config, dump_config, load_config
from pipeline.export.run import read_run
from pipeline.localization import localize
from pipeline.logs.messages import Log
from pipeline.logs.reader import read_log
from pipeline.logs.transforms_file import read_transforms
from pipeline.logs.tum import read_tum
from pipeline.maps.map_server import save_map
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.simulate import load_building, sample_dir
from recordings import STORE, Recording

LOCALIZED = 25
"""One of so many logs that could be read is localized as well."""
TINY = Config(max_particles=60, min_particles=20, init="map", recovery="none", ray_caster="dda", hindsight=False)


@dataclass(frozen=True)
class Target:
    """What reads a file: sound ``seeds`` by name, how they are mangled, and what ``reads`` them in a folder."""

    seeds: Callable[[], dict[str, bytes]]
    mangle: mangling.Mangle
    reads: Callable[[Path], None]


# --- what reads -----------------------------------------------------------------------------------------------------


def _sound(log: Log) -> None:
    assert np.isfinite(log.odometry).all(), "odometry that is no number"
    assert (np.diff(log.stamps) >= 0).all(), "stamps that decrease"
    assert np.isfinite(log.laser.pose).all(), "a laser that is nowhere"
    assert np.isfinite([log.laser.angle_min, log.laser.angle_increment, log.laser.range_min]).all(), "no angles"
    assert not (log.ranges < 0).any(), "ranges below zero"
    if log.grid is not None:
        _sound_grid(log.grid)


def _sound_grid(grid: OccupancyGrid) -> None:
    known = grid.occupancy[grid.known]
    assert not len(known) or (known.min() >= 0.0 and known.max() <= 1.0), "occupancy out of bounds"
    assert np.isfinite([grid.resolution, *grid.origin]).all(), "a map that is nowhere"
    assert grid.resolution > 0.0


def _use(log: Log, path: Path) -> None:
    """As a command would: looked at, and some localized, which ones ``path``, the mangled file, decides."""
    _sound(log)
    at_a_glance(log, TINY)
    if zlib.crc32(path.read_bytes()) % LOCALIZED == 0 and len(log):
        log = log if log.grid is not None else dataclasses.replace(log, grid=_grid())
        result = localize(log, TINY, seed=0, threads=1)
        assert np.isfinite(result.poses).all(), "a pose that is no number"


def _mcap(path: Path) -> None:
    _use(read_log(path, None if path.stat().st_size % 2 else _grid()), path)


def _converted(path: Path) -> None:
    out = path.with_name("out.mcap")
    convert([path], out)
    _use(read_log(out, _grid()), path)


def _map(path: Path) -> None:
    _sound_grid(read_map(path))


def _map_beside_image(path: Path) -> None:
    (path.parent / "map.pgm").write_bytes(_map_files()["map.pgm"])
    _map(path)


def _image(path: Path) -> None:
    (path.parent / "map.yaml").write_bytes(_map_files()["map.yaml"].replace(b"map.pgm", path.name.encode()))
    _map(path.parent / "map.yaml")


def _configuration(path: Path) -> None:
    config = load_config(path, remark=_one_line)
    assert load_config(_written(path.with_name("again.yaml"), dump_config(config))) == config


def _parameter_file(path: Path) -> None:
    """Checked, and written into: what was written is there, and may be written again."""
    file, found = checked(path)
    for finding in [*found, *findings_of_file(file)]:
        _one_line(finding.text)
    text = path.read_bytes().decode()
    new = nav2.written(text, {"sigma_hit": 0.123}, path)
    assert nav2.written(new, {"sigma_hit": 0.123}, path) == new
    assert nav2.given_of_layout(nav2.layout_of(new, path)).get("sigma_hit") == 0.123


def _written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def _one_line(text: str) -> None:
    assert "\n" not in text


def _recording(path: Path) -> None:
    run = read_run(path)
    assert np.isfinite(run.told.poses).all(), "a pose that is no number"
    run.told.to_dict()
    run.told.event_rows()


def _tum(path: Path) -> None:
    trajectory = read_tum(path)
    assert np.isfinite(trajectory.poses).all()


# --- sound files --------------------------------------------------------------------------------------------------


@cache
def _grid() -> OccupancyGrid:
    cells = np.zeros((24, 30), np.float32)
    cells[[0, -1]], cells[:, [0, -1]], cells[10, 5:20] = 1.0, 1.0, 1.0
    return OccupancyGrid(cells, 0.5)


@cache
def _entries() -> Recording:
    recording = Recording()
    recording.transforms(
        ("base_footprint", "base_link", (0.0, 0.0, 0.1), (0.0, 0.0, 0.0, 1.0)),
        ("base_link", "hokuyo_link", (0.2, 0.0, 0.3), (0.0, 0.0, 0.0, 1.0)),
    )
    for k in range(12):
        stamp = 1_700_000_000_000_000_000 + k * 200_000_000
        recording.odometry(stamp, 0.1 * k, 0.02 * k, 0.05 * k)
        recording.scan(stamp + 50_000_000, [1.0 + 0.1 * k, 2.0, 3.0, float("inf"), 5.0, 4.0, 3.0, 2.5])
        recording.imu(stamp + 20_000_000, (0.0, 0.0, 0.2))
    recording.grid(np.zeros((4, 5), np.int8), 0.5, 0.0, 0.0, 0.0)
    return recording


@cache
def _mcaps() -> dict[str, bytes]:
    found = {}
    for name, chunked, packed in (
        ("plain", False, CompressionType.NONE),
        ("chunks", True, CompressionType.NONE),
        ("zstd", True, CompressionType.ZSTD),
    ):
        path = Path(tempfile.mkdtemp(prefix="mcl-fuzz-")) / "a.mcap"
        with path.open("wb") as file:
            writer = Writer(file, compression=packed, use_chunking=chunked, enable_crcs=name == "zstd")
            writer.start(profile="ros2")
            channels: dict[str, int] = {}
            for topic, kind, stamp, sequence, data in _entries().entries:
                if topic not in channels:
                    text = STORE.generate_msgdef(kind, ros_version=2)[0].encode()
                    schema = writer.register_schema(kind, "ros2msg", text)
                    channels[topic] = writer.register_channel(topic, "cdr", schema)
                writer.add_message(channels[topic], log_time=stamp, publish_time=stamp, sequence=sequence, data=data)
            writer.finish()
        found[f"{name}.mcap"] = path.read_bytes()
    return found


@cache
def _own() -> dict[str, bytes]:
    """What `convert` makes, with map, metadata and attachments."""
    folder = Path(tempfile.mkdtemp(prefix="mcl-fuzz-"))
    (folder / "a.log").write_bytes(_cmu()["a.log"])
    save_map(_grid(), folder / "map.yaml")
    convert([folder / "a.log"], folder / "own.mcap", map_path=folder / "map.yaml")
    return {"own.mcap": (folder / "own.mcap").read_bytes()}


@cache
def _bags() -> dict[str, bytes]:
    from rosbags.rosbag1 import Writer as Ros1Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
    path = Path(tempfile.mkdtemp(prefix="mcl-fuzz-")) / "a.bag"
    with Ros1Writer(path) as bag:
        topics: dict[str, Any] = {}
        for topic, kind, stamp, _, data in _entries().entries:
            if topic not in topics:
                topics[topic] = bag.add_connection(topic, kind, typestore=store)
            message = _counted(STORE.deserialize_cdr(data, kind), store)
            bag.write(topics[topic], stamp, store.serialize_ros1(message, kind))
    return {"a.bag": path.read_bytes()}


def _counted(message: Any, store: Any) -> Any:
    """The same message with ROS 1's headers, which count."""
    for name, value in vars(message).items():
        if name == "header":
            header = store.types["std_msgs/msg/Header"](seq=7, stamp=value.stamp, frame_id=value.frame_id)
            object.__setattr__(message, name, header)
        for item in value if isinstance(value, list) else ():
            _counted(item, store)
    return message


@cache
def _databases() -> dict[str, bytes]:
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Ros2Writer

    folder = Path(tempfile.mkdtemp(prefix="mcl-fuzz-")) / "bag"
    with Ros2Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        topics: dict[str, Any] = {}
        for topic, kind, stamp, _, data in _entries().entries:
            if topic not in topics:
                topics[topic] = bag.add_connection(topic, kind, typestore=STORE)
            bag.write(topics[topic], stamp, data)
    return {"a.db3": next(folder.glob("*.db3")).read_bytes()}


@cache
def _cmu() -> dict[str, bytes]:
    lines = gzip.decompress((sample_dir() / "office.log.gz").read_bytes()).split(b"\n")
    return {"a.log": b"\n".join(lines[:24]) + b"\n", "long.log": b"\n".join(lines[:140]) + b"\n"}


def _carmen() -> dict[str, bytes]:
    lines = ["# a comment", "PARAM robot_frontlaser_offset 0.2"]
    for k in range(10):
        lines.append(f"ODOM {0.1 * k:.3f} 0.0 0.0{k} 0.1 0.0 0.0 {k}.0 robot {k}.0")
        ranges = " ".join(f"{1.0 + 0.1 * (k + b):.2f}" for b in range(12))
        lines.append(f"FLASER 12 {ranges} {0.1 * k:.3f} 0.0 0.0 {0.1 * k:.3f} 0.0 0.0 {k}.1 robot {k}.1")
    raw = [line for line in lines if line.startswith(("#", "PARAM", "ODOM"))]
    readings = " ".join(["2.00"] * 12)
    raw += [
        f"RAWLASER1 0 -1.57 3.14 0.26 20.0 0.01 0 12 {readings} 0 {k}.2 robot {k}.2" for k in range(9)
    ]  # fmt: skip
    return {"a.clf": "\n".join(lines).encode() + b"\n", "raw.clf": "\n".join(raw).encode() + b"\n"}


@cache
def _map_files() -> dict[str, bytes]:
    folder = Path(tempfile.mkdtemp(prefix="mcl-fuzz-"))
    save_map(_grid(), folder / "map.yaml")
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@cache
def _images() -> dict[str, bytes]:
    from PIL import Image

    folder = Path(tempfile.mkdtemp(prefix="mcl-fuzz-"))
    save_map(_grid(), folder / "map.yaml", "scale")
    grey = np.random.default_rng(0).integers(0, 256, (20, 30), np.uint8)
    for name in ("a.png", "b.bmp", "c.tif", "d.gif", "e.jpg", "f.webp"):
        Image.fromarray(grey).save(folder / name)
    found = {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix != ".yaml"}
    return found | {"map.pgm": _map_files()["map.pgm"], "text.pgm": b"P2\n3 2\n255\n0 100 255\n3 4 5\n"}


def _beesoft() -> dict[str, bytes]:
    rows = "\n".join(" ".join(["-1", "0.5", "0.0", "1.0"]) for _ in range(4))
    head = "robot_specifications->global_mapsize_x 40\nrobot_specifications->global_mapsize_y 40\n"
    head += "robot_specifications->resolution 10\nrobot_specifications->autoshifted_x 0\n"
    return {"a.dat": f"{head}robot_specifications->autoshifted_y 0\n\nglobal_map[0]: 4 4\n{rows}\n".encode()}


LAUNCH = b"""\
<launch>
  <arg name="beams" default="40"/>
  <node pkg="amcl" type="amcl" name="amcl">
    <param name="odom_alpha1" value="0.2" unless="false"/>
    <param name="laser_max_beams" value="$(arg beams)"/>
    <rosparam>{laser_z_hit: 0.9, initial_pose_x: 1.0}</rosparam>
  </node>
</launch>
"""
NAV2 = b"""\
amcl:
  ros__parameters:
    use_sim_time: true
    alpha1: 0.2
    alpha2: 0.2
    base_frame_id: "base_footprint"
    laser_model_type: "likelihood_field"
    laser_max_range: 100.0
    max_beams: 60
    max_particles: 2000
    min_particles: 500
    robot_model_type: "nav2_amcl::DifferentialMotionModel"
    set_initial_pose: true
    initial_pose: {x: 1.0, y: 2.0, z: 0.0, yaw: 0.5}
    sigma_hit: 0.2
    z_hit: 0.5
    z_rand: 0.5
"""
TUM = b"# a comment\n0.0 1 2 0 0 0 0 1\n1.0 1.5 2 0 0 0 0.1 0.99\n"
TRANSFORMS = b"""\
- {parent: base_footprint, child: base_link, z: 0.1}
- header: {frame_id: base_link}
  child_frame_id: laser
  transform:
    translation: {x: 0.2, y: 0.0, z: 0.3}
    rotation: {x: 0.0, y: 0.0, z: 0.0, w: 1.0}
"""


@cache
def _own_config() -> dict[str, bytes]:
    return {"a.yaml": dump_config(Config()).encode()}


@cache
def _buildings() -> dict[str, bytes]:
    return {"a.yaml": (sample_dir() / "building.yaml").read_bytes()}


@cache
def _runs() -> dict[str, bytes]:
    from pipeline.recording.run_folder import create
    from pipeline.replay import replay

    folder = Path(tempfile.mkdtemp(prefix="mcl-fuzz-"))
    (folder / "own.mcap").write_bytes(_own()["own.mcap"])
    log = read_log(folder / "own.mcap")
    run = create("fuzz", folder / "run")
    replay(log, TINY.model_copy(update={"record_particles": 5}), run, threads=1)
    return {"run.rrd": run.recording.read_bytes()}


TARGETS: dict[str, Target] = {
    "mcap": Target(_mcaps, mangling.of_mcap, _mcap),
    "bag-mcap": Target(_mcaps, mangling.of_mcap, _converted),
    "own": Target(_own, mangling.of_mcap, _mcap),
    "bag": Target(_bags, mangling.of_bag, _converted),
    "db3": Target(_databases, mangling.of_bytes, _converted),
    "cmu": Target(_cmu, mangling.of_lines, _converted),
    "carmen": Target(_carmen, mangling.of_lines, _converted),
    "map": Target(lambda: {"a.yaml": _map_files()["map.yaml"]}, mangling.of_yaml, _map_beside_image),
    "image": Target(_images, mangling.of_image, _image),
    "beesoft": Target(_beesoft, mangling.of_lines, _map),
    "config": Target(_own_config, mangling.of_yaml, _configuration),
    "nav2": Target(lambda: {"a.yaml": NAV2}, mangling.of_yaml, _configuration),
    "amcl": Target(lambda: {"a.yaml": NAV2}, mangling.of_yaml, _parameter_file),
    "launch": Target(lambda: {"a.launch": LAUNCH}, mangling.of_lines, _configuration),
    "tf": Target(lambda: {"a.yaml": TRANSFORMS}, mangling.of_yaml, lambda path: void(read_transforms(path))),
    "building": Target(_buildings, mangling.of_yaml, lambda path: void(load_building(path))),
    "tum": Target(lambda: {"a.tum": TUM}, mangling.of_lines, _tum),
    "rrd": Target(_runs, mangling.of_bytes, _recording),
}  # fmt: skip
SLOW = {"rrd": 20, "bag": 4, "db3": 4, "building": 20, "config": 2, "nav2": 2, "amcl": 2}
"""Targets of which one of so many turns is run: they take so much longer."""


def void(_: object) -> None:
    """Whatever it is."""
