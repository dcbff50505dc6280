"""What a run found, beside what it was found from: read back by other people's readers, not by our own."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.geometry import compose, quaternion_to_yaw
from pipeline.localization import localize
from pipeline.logs import schema
from pipeline.logs.messages import Log, Trajectory
from pipeline.logs.reader import read_log
from pipeline.logs.result import LEVELS, ResultFile
from pipeline.logs.tum import write_tum
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.recording.run_folder import create
from pipeline.replay import replay
from recordings import UPRIGHT, Recording, T, header, link, ordinary, pose

QUICK = Config(max_particles=300, min_particles=300, init="free_space", recovery="none", record_particles=40)
SECOND = 1_000_000_000
GRID = OccupancyGrid(np.zeros((4, 6), np.float32), 0.5, (-1.0, -2.0, 0.3))
COVARIANCE = np.array([[0.4, 0.1, 0.02], [0.1, 0.3, 0.03], [0.02, 0.03, 0.2]])


def read(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """(log time, message) by topic, decoded by rosbags with the definitions that the file brings along."""
    found: dict[str, list[tuple[int, Any]]] = {}
    with AnyReader([path]) as reader:
        for connection, at, data in reader.messages():
            found.setdefault(connection.topic, []).append((at, reader.deserialize(data, connection.msgtype)))
    return found


def planar(position: Any, orientation: Any) -> np.ndarray:
    q = orientation
    assert math.hypot(q.x, q.y, q.z, q.w) == pytest.approx(1.0, abs=1e-6)
    return np.array([position.x, position.y, float(quaternion_to_yaw(q.x, q.y, q.z, q.w))])


def stamp(message: Any) -> int:
    return int(message.header.stamp.sec) * SECOND + int(message.header.stamp.nanosec)


def transforms(found: dict[str, list[tuple[int, Any]]], topic: str = "/tf") -> dict[tuple[str, str], list[Any]]:
    links: dict[tuple[str, str], list[Any]] = {}
    for _, message in found.get(topic, []):
        for sent in message.transforms:
            links.setdefault((sent.header.frame_id, sent.child_frame_id), []).append(sent)
    return links


def links_at(links: list[Any]) -> dict[int, np.ndarray]:
    return {stamp(link): planar(link.transform.translation, link.transform.rotation) for link in links}


def same(a: np.ndarray, b: np.ndarray, within: float = 1e-6) -> None:
    off = np.asarray(a) - np.asarray(b)
    off[..., 2] = (off[..., 2] + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(off, 0.0, atol=within)


# --- of a whole run


@pytest.fixture(scope="module")
def run(office: Log, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("run")
    replay(office, QUICK, create("office", folder / "run"), seed=3, mcap=folder / "result.mcap", record=False)
    return folder / "result.mcap", folder / "run" / "trajectory.tum"


def test_the_estimate_is_that_of_the_trajectory(run: tuple[Path, Path]) -> None:
    rows = np.loadtxt(run[1])
    poses = read(run[0])["/amcl_pose"]
    assert len(poses) == len(rows)
    np.testing.assert_allclose([stamp(m) / SECOND for _, m in poses], rows[:, 0], atol=1e-9)
    assert {m.header.frame_id for _, m in poses} == {"map"}
    same(
        np.array([planar(m.pose.pose.position, m.pose.pose.orientation) for _, m in poses]),
        np.column_stack([rows[:, 1:3], quaternion_to_yaw(*rows[:, 4:].T)]),
    )


def test_map_to_odom_with_odom_to_base_is_the_estimate(run: tuple[Path, Path], office: Log) -> None:
    links = transforms(read(run[0]))
    assert set(links) == {("map", "odom"), ("odom", "base_link")}
    corrections, odometry = links_at(links["map", "odom"]), links_at(links["odom", "base_link"])
    assert len(corrections) == len(office)
    rows = np.loadtxt(run[1])
    chained = np.array([compose(corrections[s], odometry[s]) for s in office.stamps.tolist()])
    same(chained, np.column_stack([rows[:, 1:3], quaternion_to_yaw(*rows[:, 4:].T)]))


def test_particles_travel_with_their_weights(run: tuple[Path, Path], office: Log) -> None:
    found = read(run[0])
    clouds, arrays = found["/particle_cloud"], found["/particlecloud"]
    assert len(clouds) == len(arrays) == len(office)
    for (_, cloud), (_, array) in zip(clouds[::50], arrays[::50], strict=True):
        assert len(cloud.particles) == len(array.poses) == QUICK.record_particles
        assert sum(p.weight for p in cloud.particles) == pytest.approx(1.0, abs=1e-5)
        assert [p.pose for p in cloud.particles] == array.poses


def test_every_scan_has_a_diagnosis(run: tuple[Path, Path], office: Log) -> None:
    """The verdict as monitors show it, at the scan's own stamp and time, with what it rests on."""
    found, folder = read(run[0]), run[1].parent
    assert [(at, stamp(m)) for at, m in found["/diagnostics"]] == [(at, stamp(m)) for at, m in found["/amcl_pose"]]
    told = json.loads((folder / "run.json").read_text())["figures"]["verdict"]
    kinds: list[str] = []
    for _, message in found["/diagnostics"]:
        (status,) = message.status
        assert status.name == "mcl: localization"
        assert status.level == LEVELS[status.message]
        values = {pair.key: pair.value for pair in status.values}
        assert 0.0 <= float(values.pop("probability of being right")) <= 1.0
        places = values.pop("places")
        assert re.match(r"\d+ % at \(-?\d+\.\d\d, -?\d+\.\d\d\)", places)
        assert all(-0.001 <= float(value) <= 1.001 for value in values.values())
        assert len(values) == 5
        kinds.append(status.message)
    assert len(kinds) == len(office)
    assert kinds[-1] == told["at_end"]
    shares = {kind: kinds.count(kind) / len(kinds) for kind in LEVELS}
    assert shares == pytest.approx(told["shares"])


def test_particles_are_the_filters(office: Log, tmp_path: Path) -> None:
    shown: list[np.ndarray] = []

    class Watch:
        def log(self, step: Any) -> None:
            shown.append(np.column_stack([step.particles, np.exp(step.log_weights)]))

    short = first(office, 3)
    whole = QUICK.model_copy(update={"record_particles": 1000})
    replay(short, whole, create("x", tmp_path / "run"), seed=3, mcap=tmp_path / "a.mcap", record=False)
    localize(short, whole, seed=3, sinks=[Watch()])
    for (_, cloud), expected in zip(read(tmp_path / "a.mcap")["/particle_cloud"], shown, strict=True):
        poses = np.array([planar(p.pose.position, p.pose.orientation) for p in cloud.particles])
        same(poses, expected[:, :3].astype(float), within=2e-6)
        np.testing.assert_allclose([p.weight for p in cloud.particles], expected[:, 3], rtol=1e-5)


def test_the_input_is_there_as_it_was(run: tuple[Path, Path], office: Log) -> None:
    again, before, found = read_log(run[0]), read(office.path), read(run[0])
    assert again.grid is not None
    assert office.grid is not None
    assert again.grid.sha256 == office.grid.sha256
    np.testing.assert_array_equal(again.ranges, office.ranges)
    np.testing.assert_array_equal(again.odometry, office.odometry)
    assert {**again.metadata, "mcl:result": {}} == {**office.metadata, "mcl:result": {}}
    for topic in ("/scan", "/odom", "/map", "/tf_static", "/ground_truth", "/view/robot"):
        assert [at for at, _ in found[topic]] == [at for at, _ in before[topic]]
    assert "/view/tf" in before
    assert "/view/tf" not in found  # the odometry was drawn beside the map, and is in it now
    said = again.metadata["mcl:result"]
    assert said["seed"] == "3"
    assert YAML(typ="safe").load(said["config"])["record_particles"] == QUICK.record_particles


def test_the_conventions_are_those_of_every_log(run: tuple[Path, Path]) -> None:
    with run[0].open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}
        channels = {channel.topic: channel for channel in summary.channels.values()}
        assert len(channels) == len(summary.channels)
        assert set(schema.RESULT_TYPES) < set(channels)
        for topic, kind in schema.RESULT_TYPES.items():
            assert summary.schemas[channels[topic].schema_id].name == kind
            (qos,) = YAML(typ="safe").load(channels[topic].metadata["offered_qos_profiles"])
            assert qos["durability"] == (1 if topic == "/amcl_pose" else 2)  # so that who comes late is told
        decoded = {channel.topic: message for _, channel, _, message in reader.iter_decoded_messages()}
    cloud = decoded["/particle_cloud"]
    assert len(cloud.particles) == QUICK.record_particles
    assert math.hypot(cloud.particles[0].pose.orientation.z, cloud.particles[0].pose.orientation.w) == pytest.approx(1)
    assert decoded["/amcl_pose"].header.frame_id == "map"


def test_a_trajectory_is_what_evo_reads(run: tuple[Path, Path]) -> None:
    """`evo_ape tum` wants eight numbers a row, apart by one space; evo then checks order and quaternions."""
    lines = run[1].read_text().splitlines()
    cells = [line.split(" ") for line in lines]
    assert {len(row) for row in cells} == {8}
    rows = np.array(cells, dtype=float)
    assert (np.diff(rows[:, 0]) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(rows[:, 4:], axis=1), 1.0, atol=1e-8)


# --- of other robots' recordings


def first(log: Log, scans: int) -> Log:
    return dataclasses.replace(log, stamps=log.stamps[:scans], odometry=log.odometry[:scans], ranges=log.ranges[:scans])


def written(recording: Recording, path: Path, **options: Any) -> tuple[Log, np.ndarray, dict[str, list[Any]]]:
    """A result with an estimate of its own for every scan, beside the recording's messages."""
    log = read_log(recording.write(path / "theirs.mcap"), **options)
    if log.grid is None:
        log = dataclasses.replace(log, grid=GRID)
    estimates = np.column_stack([np.linspace(5, 9, len(log)), np.full(len(log), -3.0), np.linspace(3, 3.5, len(log))])
    with ResultFile(path / "result.mcap", log) as result:
        for i, estimate in enumerate(estimates):
            result.write(i, estimate, COVARIANCE, np.zeros((0, 3), np.float32), np.zeros(0))
    return log, estimates, read(path / "result.mcap")


def test_frames_and_topics_are_theirs(tmp_path: Path) -> None:
    log, estimates, found = written(ordinary(), tmp_path)
    links = transforms(found)
    # Nobody had put the odometry on /tf, without which map -> odom would lead nowhere.
    assert set(links) == {("map", "odom_combined"), ("odom_combined", "base_footprint")}
    corrections = links_at(links["map", "odom_combined"])
    odometry = links_at(links["odom_combined", "base_footprint"])
    same(np.array([compose(corrections[s], odometry[s]) for s in log.stamps.tolist()]), estimates)
    assert len(found["/base/scan_front"]) == 10
    assert len(found["/robot/odometry"]) == 21


def test_a_covariance_stands_where_ros_has_it(tmp_path: Path) -> None:
    _, _, found = written(ordinary(), tmp_path)
    whole = found["/amcl_pose"][0][1].pose.covariance.reshape(6, 6)
    np.testing.assert_allclose(whole[np.ix_((0, 1, 5), (0, 1, 5))], COVARIANCE)
    assert np.count_nonzero(whole) == 9


def test_a_cloud_of_nothing_is_no_error(tmp_path: Path) -> None:
    _, _, found = written(ordinary(), tmp_path)
    assert all(len(message.particles) == 0 for _, message in found["/particle_cloud"])


def with_a_localization_of_its_own() -> Recording:
    """Somebody ran AMCL while it was recorded; and an EKF's odom -> base differs from the wheels' odometry."""
    recording = ordinary()
    for i in range(21):
        at = SECOND + i * 50_000_000
        link(recording, at, "map", "odom_combined", 100.0)
        link(recording, at, "odom_combined", "base_footprint", 0.2 * i, 0.1)
    covariance = T["geometry_msgs/msg/PoseWithCovariance"](pose=pose(99.0, 0.0, UPRIGHT), covariance=np.zeros(36))
    kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
    recording.put("/amcl_pose", kind, SECOND, T[kind](header=header(SECOND, "map"), pose=covariance))
    return recording


def test_a_localization_in_the_input_makes_room(tmp_path: Path) -> None:
    log, estimates, found = written(with_a_localization_of_its_own(), tmp_path)
    links = transforms(found)
    assert len(links["map", "odom_combined"]) == len(log)
    assert len(links["odom_combined", "base_footprint"]) == 21
    assert set(transforms(found, "/recorded/tf")) == {("map", "odom_combined")}
    assert len(transforms(found, "/recorded/tf")["map", "odom_combined"]) == 21
    assert [m.pose.pose.position.x for _, m in found["/recorded/amcl_pose"]] == [99.0]
    assert len(found["/amcl_pose"]) == len(log)
    # The link that a viewer chains with is the one on /tf, at 0.2 m per 50 ms, turned by 0.1.
    corrections = links_at(links["map", "odom_combined"])
    for at, estimate in zip(log.stamps.tolist(), estimates, strict=True):
        same(compose(corrections[at], [4.0 * (at - SECOND) / SECOND, 0.0, 0.1]), estimate)


def test_results_play_with_the_scans_whatever_the_recorders_clock(tmp_path: Path) -> None:
    """A simulator's stamps begin at zero; its recorder writes what the wall's clock says."""
    recording, offset = ordinary(), 1_700_000_000 * SECOND
    recording.entries = [(t, k, at + offset, n, data) for t, k, at, n, data in recording.entries]
    log, _, found = written(recording, tmp_path)
    assert [at for at, _ in found["/amcl_pose"]] == [at for at, _ in found["/base/scan_front"]]
    assert [stamp(m) for _, m in found["/amcl_pose"]] == log.stamps.tolist()


def test_a_map_of_another_file_takes_the_place_of_theirs(tmp_path: Path) -> None:
    recording = ordinary()
    recording.grid(np.zeros((2, 2), np.int8), 1.0, 0.0, 0.0, 0.0)
    _, _, found = written(recording, tmp_path, grid=GRID)
    assert len(found["/map_server/map"]) == 1
    ((_, drawn),) = found["/map"]
    assert (drawn.info.width, drawn.info.height, drawn.header.frame_id) == (6, 4, "map")
    again = read_log(tmp_path / "result.mcap")
    assert again.grid is not None
    assert again.grid.sha256 == GRID.sha256


def test_a_map_of_their_own_stays_as_it_is(tmp_path: Path) -> None:
    recording = ordinary()
    recording.grid(np.zeros((2, 2), np.int8), 1.0, 0.0, 0.0, 0.0)
    _, _, found = written(recording, tmp_path)
    assert "/map" not in found
    assert len(found["/map_server/map"]) == 1


# --- whole or not at all


def test_what_is_stopped_leaves_nothing(office: Log, tmp_path: Path) -> None:
    def progress(items: Any, total: int, label: str) -> Any:
        for scan in items:
            if scan.index == 5:
                raise KeyboardInterrupt
            yield scan

    with pytest.raises(KeyboardInterrupt):
        replay(office, QUICK, create("x", tmp_path / "run"), mcap=tmp_path / "a.mcap", record=False, progress=progress)
    assert list(tmp_path.iterdir()) == []


def test_no_file_is_overwritten(office: Log, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("before")
    with pytest.raises(MclError, match=r"a\.mcap: this file exists already"):
        ResultFile(path, office)
    with pytest.raises(MclError, match="exists already"):
        ResultFile(office.path, office)
    assert path.read_text() == "before"


def test_the_same_run_writes_the_same_file(run: tuple[Path, Path], office: Log, tmp_path: Path) -> None:
    replay(office, QUICK, create("x", tmp_path / "run"), seed=3, mcap=tmp_path / "a.mcap", record=False)
    assert (tmp_path / "a.mcap").read_bytes() == run[0].read_bytes()


def test_a_trajectory_by_hand_is_read_as_well(tmp_path: Path) -> None:
    """Stamps since 1970 keep their nanoseconds, which a double would not."""
    stamps = 1_700_000_000 * SECOND + np.array([1, 2, 3])
    write_tum(tmp_path / "a.tum", Trajectory(stamps, np.zeros((3, 3))))
    assert [line.split()[0] for line in (tmp_path / "a.tum").read_text().splitlines()] == [
        f"1700000000.00000000{i}" for i in (1, 2, 3)
    ]
