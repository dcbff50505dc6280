"""Our .mcap files in others' programs: what `ros2 bag play` needs, rosbags, mcap-ros2-support, and rerun's check.

rosbag2 takes a bare .mcap if its profile, encodings, statistics and summary are there, and offers each topic as its
``offered_qos_profiles`` say: without "transient local" nobody who comes late would get the map.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML
from test_bag import driven, ros1
from test_carmen import flaser

from converters import convert
from pipeline.logs import schema
from pipeline.simulate import sample_dir

RERUN = Path(sys.executable).with_name("rerun")
FOREVER = {"sec": 9223372036, "nsec": 854775807}


@pytest.fixture(scope="module", params=["cmu", "carmen", "rosbag"])
def ours(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file from every kind of source, with all that it can hold."""
    folder, sample = tmp_path_factory.mktemp(request.param), sample_dir()
    path, options = folder / "a.mcap", {"map_path": sample / "office.dat.gz"}
    if request.param == "cmu":
        truth = sample / "office_truth.tum"
        convert([sample / "office.log.gz"], path, **options, ground_truth=truth, drop=[(40.0, 50.0)])
    elif request.param == "carmen":
        lines = [flaser(f"{10 + k}", (float(k), 0.0, 0.1 * k), (1.0, 2.0, 81.91)) for k in range(5)]
        (folder / "a.log").write_text("\n".join(["TRUEPOS 5 6 0.7 1 2 0.3 10.5 host 0.5", *lines]))
        convert([folder / "a.log"], path, **options)
    else:
        convert([ros1(driven(), folder / "a.bag")], path, **options, ground_truth=Path("/tf"))
    return path


def check_structure(path: Path) -> None:
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        header, summary = reader.get_header(), reader.get_summary()
        assert header.profile == "ros2"
        assert header.library.startswith("mcl-replay/")
        assert summary is not None
        statistics = summary.statistics
        assert statistics is not None
        counted: Counter[int] = Counter()
        times: dict[int, list[int]] = {}
        for kind, channel, message in reader.iter_messages(log_time_order=False):
            assert kind is not None
            counted[channel.id] += 1
            times.setdefault(channel.id, []).append(message.log_time)
            assert message.log_time == message.publish_time
            assert message.data[:4] == b"\x00\x01\x00\x00"  # CDR, little endian
        assert dict(counted) == statistics.channel_message_counts
        assert statistics.message_count == counted.total()
        assert statistics.channel_count == len(summary.channels)
        assert statistics.schema_count == len(summary.schemas)
        assert statistics.chunk_count == len(summary.chunk_indexes) > 0
        assert statistics.metadata_count == len(summary.metadata_indexes)
        assert statistics.attachment_count == len(summary.attachment_indexes)
        assert statistics.message_start_time == min(map(min, times.values()))
        assert statistics.message_end_time == max(map(max, times.values()))
        for stamps in times.values():
            assert stamps == sorted(stamps)
        for chunk in summary.chunk_indexes:
            assert chunk.compression == "zstd"
            assert chunk.message_index_length > 0
        for channel in summary.channels.values():
            kind = summary.schemas[channel.schema_id]
            assert channel.message_encoding == "cdr"
            assert kind.encoding == "ros2msg"
            assert re.fullmatch(r"[a-z0-9_]+/msg/[A-Za-z0-9]+", kind.name)
            check_definition(kind.data.decode())
            check_quality(channel.topic, channel.metadata["offered_qos_profiles"])


def check_definition(text: str) -> None:
    """Every type that is named is also defined, as rosbag2 keeps message definitions."""
    parts = text.split("=" * 80 + "\n")
    defined = {part.split("\n", 1)[0].removeprefix("MSG: ").strip() for part in parts[1:]}
    for line in text.splitlines():
        named = re.match(r"([a-z0-9_]+/(?:msg/)?[A-Z]\w*)", line)
        if named:
            assert named[1].replace("/msg/", "/") in {name.replace("/msg/", "/") for name in defined}, line


def check_quality(topic: str, text: str) -> None:
    (profile,) = YAML(typ="safe").load(text)
    latched = topic in ("/map", "/tf_static") or re.fullmatch(r"/view/(true_)?(robot|path)", topic)
    assert profile == {
        "history": 1,  # keep the last
        "depth": 1 if latched else 10,
        "reliability": 1,  # reliable
        "durability": 1 if latched else 2,  # transient local, volatile
        "deadline": FOREVER,
        "lifespan": FOREVER,
        "liveliness": 1,
        "liveliness_lease_duration": FOREVER,
        "avoid_ros_namespace_conventions": False,
    }


def read_by_rosbags(path: Path) -> Counter[str]:
    found: Counter[str] = Counter()
    with AnyReader([path]) as reader:
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found[connection.topic] += 1
            if hasattr(message, "header"):
                assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == time
    return found


def read_by_mcap_ros2(path: Path) -> Counter[str]:
    found: Counter[str] = Counter()
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            found[channel.topic] += 1
            if channel.topic == "/scan":
                assert len(decoded.ranges) > 0
                assert decoded.header.frame_id == "laser"
                assert decoded.header.stamp.sec * 10**9 + decoded.header.stamp.nanosec == message.log_time
            if channel.topic == "/map":
                assert len(decoded.data) == decoded.info.width * decoded.info.height
    return found


def check_by_rerun(path: Path) -> str:
    done = subprocess.run(
        [RERUN, "mcap", "check", "--full", path],
        env=os.environ | {"CI": "1", "NO_COLOR": "1"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_structure_is_what_ros2_bag_play_needs(ours: Path) -> None:
    check_structure(ours)


def test_rosbags_and_mcap_ros2_read_the_same_messages(ours: Path) -> None:
    found = read_by_rosbags(ours)
    assert found == read_by_mcap_ros2(ours)
    assert set(found) >= set(schema.TYPES) - {schema.LASER_POSE, schema.IMU}
    assert found["/map"] == found["/tf_static"] == 1
    assert found["/tf"] == found["/odom"] >= 5


def test_rerun_finds_no_issue(ours: Path) -> None:
    said = check_by_rerun(ours)
    rows = [line for line in said.splitlines() if re.search(r"\s/\w+\s", line)]
    assert len(rows) >= 6
    assert all(line.startswith("ok") for line in rows), said


@pytest.mark.parametrize(
    "source",
    ["uob_pioneer/trace0.bag", "olin_mac/macfirst_floor_take_2", "carmen/fr079/fr079.log.gz", "cmu/robotdata1.log.gz"],
)
def test_real_recordings_elsewhere(shared_data: Path, tmp_path: Path, source: str) -> None:
    path = tmp_path / "a.mcap"
    report = convert([shared_data / source], path, map_path=shared_data / "uob_pioneer" / "map.yaml")
    check_structure(path)
    found = read_by_rosbags(path)
    assert found == read_by_mcap_ros2(path)
    assert (found["/scan"], found["/odom"]) == (report.scans, report.odometry)
    assert "ok" in check_by_rerun(path)
