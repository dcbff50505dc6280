"""Mangled files into everything that reads them: a result or one MclError, and nothing else, ever.

Allowed: a result whose numbers are finite where they must be, or an MclError of one line. Not allowed: any other
exception, a warning or a word of somebody else's library, more than 60 s, more than 4 GB. Every input follows from
(seed, target, number), so that a fault can be made again:

    python tests/fuzz.py --count 1000000               all targets in turn
    python tests/fuzz.py --only mcap --number 1234     one input, with its traceback, and kept as .fuzz/mcap-1234
"""

from __future__ import annotations

import argparse
import dataclasses
import gzip
import os
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import mangling  # noqa: E402
from mcap.writer import CompressionType, Writer  # noqa: E402

from converters import convert, read_map  # noqa: E402
from pipeline.check.looking import at_a_glance  # noqa: E402
from pipeline.config import Config, dump_config, load_config  # noqa: E402
from pipeline.errors import MclError  # noqa: E402
from pipeline.export.run import read_run  # noqa: E402
from pipeline.localization import localize  # noqa: E402
from pipeline.logs.messages import Log  # noqa: E402
from pipeline.logs.reader import read_log  # noqa: E402
from pipeline.logs.transforms_file import read_transforms  # noqa: E402
from pipeline.logs.tum import read_tum  # noqa: E402
from pipeline.maps.map_server import save_map  # noqa: E402
from pipeline.maps.occupancy_grid import OccupancyGrid  # noqa: E402
from pipeline.simulate import load_building, sample_dir  # noqa: E402
from recordings import STORE, Recording  # noqa: E402

SECONDS, BYTES = 60, 4_000_000_000
LOCALIZED = 25
"""Every so many logs that could be read are localized as well."""
TINY = Config(max_particles=60, min_particles=20, init="map", recovery="none", ray_caster="dda", hindsight=False)


class TooLong(BaseException):
    """More than 60 s: what catches exceptions of libraries does not catch this."""


@dataclass(frozen=True)
class Target:
    """What reads a file: sound ``seeds`` by name, how they are mangled, and what ``reads`` them in a folder."""

    seeds: Callable[[], dict[str, bytes]]
    mangle: mangling.Mangle
    reads: Callable[[Path], None]


@dataclass
class Tally:
    """How it went: inputs by target, how many were refused and read, and the faults."""

    inputs: dict[str, int] = field(default_factory=dict)
    read: dict[str, int] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)


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


_logs = 0


def _use(log: Log) -> None:
    """As a command would: looked at, and now and then localized."""
    global _logs
    _sound(log)
    at_a_glance(log, TINY)
    _logs += 1
    if _logs % LOCALIZED == 0 and len(log):
        log = log if log.grid is not None else dataclasses.replace(log, grid=_grid())
        result = localize(log, TINY, seed=0, threads=1)
        assert np.isfinite(result.poses).all(), "a pose that is no number"


def _mcap(path: Path) -> None:
    _use(read_log(path, None if path.stat().st_size % 2 else _grid()))


def _converted(path: Path) -> None:
    out = path.with_name("out.mcap")
    convert([path], out)
    _use(read_log(out, _grid()))


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
    "tf": Target(lambda: {"a.yaml": TRANSFORMS}, mangling.of_yaml, lambda path: void(read_transforms(path))),
    "building": Target(_buildings, mangling.of_yaml, lambda path: void(load_building(path))),
    "tum": Target(lambda: {"a.tum": TUM}, mangling.of_lines, _tum),
    "rrd": Target(_runs, mangling.of_bytes, _recording),
}  # fmt: skip
SLOW = {"rrd": 20, "bag": 4, "db3": 4, "building": 20, "config": 2, "nav2": 2}
"""Targets of which one of so many turns is run: they take so much longer."""


def void(_: object) -> None:
    """Whatever it is."""


# --- running them ---------------------------------------------------------------------------------------------------


def mangled(target: str, seed: int, number: int) -> tuple[str, bytes]:
    """The input of that number: its name and content."""
    rng = random.Random(f"{seed} {target} {number}")
    seeds = TARGETS[target].seeds()
    name = rng.choice(sorted(seeds))
    return name, TARGETS[target].mangle(seeds[name], rng)


def fault_of(target: str, name: str, content: bytes, folder: Path) -> tuple[str, bool]:
    """What is wrong with how an input is taken, as a text, empty if nothing is; and whether it was read."""
    path = folder / name
    path.write_bytes(content)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    read = False
    try:
        with _silent(folder) as spoken, _limited():
            TARGETS[target].reads(path)
            read = True
    except MclError as error:
        if not str(error).strip() or "\n" in str(error):
            return f"an error that is not one line: {str(error)!r}", read
    except TooLong:
        return f"it takes more than {SECONDS} s", read
    except KeyboardInterrupt:
        raise
    except BaseException:
        return traceback.format_exc(), read
    finally:
        for left in folder.iterdir():
            left.unlink()
    if said := "".join(spoken):
        return f"somebody spoke: {said[:2000]}", read
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    return (f"it takes {grown / 1e9:.1f} GB", read) if grown > BYTES else ("", read)


@contextmanager
def _limited() -> Iterator[None]:
    def end(_number: int, _frame: FrameType | None) -> None:
        raise TooLong

    # By the processor's time, for others may be at work here; and by the clock, for whoever waits uses none.
    before = [(number, signal.signal(number, end)) for number in (signal.SIGPROF, signal.SIGALRM)]
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    signal.alarm(10 * SECONDS)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            yield
    finally:
        signal.alarm(0)
        signal.setitimer(signal.ITIMER_PROF, 0)
        for number, handler in before:
            signal.signal(number, handler)


@contextmanager
def _silent(folder: Path) -> Iterator[list[str]]:
    """What is written to stdout and stderr meanwhile, by whatever language."""
    spoken: list[str] = []
    sys.stdout.flush(), sys.stderr.flush()
    kept = os.dup(1), os.dup(2)
    with tempfile.TemporaryFile() as said:
        os.dup2(said.fileno(), 1)
        os.dup2(said.fileno(), 2)
        try:
            yield spoken
        finally:
            sys.stdout.flush(), sys.stderr.flush()
            os.dup2(kept[0], 1)
            os.dup2(kept[1], 2)
            for descriptor in kept:
                os.close(descriptor)
            said.seek(0)
            spoken.append(said.read().decode(errors="replace"))


def turns(only: Sequence[str], first: int = 0) -> Iterator[tuple[str, int]]:
    """Targets with the numbers of their inputs, in turn, without end."""
    number = first
    while True:
        for target in only:
            every = SLOW.get(target, 1)
            if number % every == 0:
                yield target, number // every
        number += 1


def fuzz(
    count: int, seed: int, only: Sequence[str] = tuple(TARGETS), seconds: float = float("inf"), first: int = 0
) -> Tally:
    """Try so many inputs, or for so many seconds."""
    tally, end = Tally(), time.monotonic() + seconds
    kept = Path(os.environ.get("MCL_FUZZ_DIR", ".fuzz"))
    with tempfile.TemporaryDirectory(prefix="mcl-fuzz-") as home:
        os.environ.setdefault("MCL_CACHE_DIR", home + "/cache")
        folder = Path(home) / "files"
        folder.mkdir()
        for done, (target, number) in enumerate(turns(only, first)):
            if done >= count or time.monotonic() > end:
                break
            name, content = mangled(target, seed, number)
            fault, read = fault_of(target, name, content, folder)
            tally.inputs[target] = tally.inputs.get(target, 0) + 1
            tally.read[target] = tally.read.get(target, 0) + read
            if fault:
                kept.mkdir(parents=True, exist_ok=True)
                (kept / f"{target}-{number}-{name}").write_bytes(content)
                (kept / f"{target}-{number}.txt").write_text(fault)
                tally.faults.append(f"{target} {number}: {fault.strip().splitlines()[-1]}")
    return tally


def main() -> None:
    """As the command line says."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    parser.add_argument("--only", choices=list(TARGETS), action="append")
    parser.add_argument("--number", type=int, help="one input of the target, with its traceback")
    asked = parser.parse_args()
    only = asked.only or list(TARGETS)
    if asked.number is not None:
        name, content = mangled(only[0], asked.seed, asked.number)
        with tempfile.TemporaryDirectory(prefix="mcl-fuzz-") as folder:
            print(name, len(content), fault_of(only[0], name, content, Path(folder)))
        return
    begun = time.monotonic()
    tally = fuzz(asked.count, asked.seed, only, asked.seconds, asked.first)
    for target, count in tally.inputs.items():
        print(f"{target:<10} {count:>9,} inputs, {tally.read[target]:>9,} of them read")
    print(f"{sum(tally.inputs.values()):,} inputs in {time.monotonic() - begun:.0f} s, {len(tally.faults)} faults")
    for fault in tally.faults[:200]:
        print(fault)
    sys.exit(bool(tally.faults))


if __name__ == "__main__":
    main()
