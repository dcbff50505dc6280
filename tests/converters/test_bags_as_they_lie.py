"""Bags whose metadata are wrong, missing or of another machine, and what a killed recorder left of them."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np
import pytest
from drives import looped, ordinary_drive
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from test_bag import as_ros1, ros1, ros1_store, ros2

from converters import convert
from pipeline.errors import MclError
from pipeline.logs.messages import Log
from pipeline.logs.reader import read_log
from recordings import STORE

PLUGINS = [StoragePlugin.SQLITE3, StoragePlugin.MCAP]


def converted(path: Path, tmp_path: Path) -> tuple[Log, str]:
    report = convert([path], tmp_path / "out.mcap")
    return read_log(tmp_path / "out.mcap"), " ".join(report.remarks)


def same(log: Log, other: Log) -> bool:
    return bool(
        np.array_equal(log.stamps, other.stamps)
        and np.array_equal(log.odometry, other.odometry)
        and np.array_equal(log.ranges, other.ranges, equal_nan=True)
    )


@pytest.mark.parametrize("plugin", PLUGINS)
@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("storage_identifier: sqlite3", 'storage_identifier: ""').replace(
            "storage_identifier: mcap", 'storage_identifier: ""'
        ),
        lambda text: text.replace("version: 9", "version: 99"),
        lambda text: text[: len(text) // 2],
        lambda text: text.replace("- bag", "- /robots/theirs/bags/bag"),
        lambda text: "",
        None,
    ],
)
def test_the_files_count_and_not_their_metadata(tmp_path: Path, plugin: StoragePlugin, change) -> None:
    folder = ros2(ordinary_drive(), tmp_path / "bag", plugin)
    metadata = folder / "metadata.yaml"
    if change is None:
        metadata.unlink()
    else:
        metadata.write_text(change(metadata.read_text()))
    log, said = converted(folder, tmp_path)
    assert same(log, read_log(ordinary_drive().write(tmp_path / "a.mcap")))
    assert said == ""


def test_parts_follow_each_other_by_their_numbers(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    whole = ordinary_drive()
    entries = whole.entries
    for k in range(11):
        whole.entries = entries[k * 11 : (k + 1) * 11]
        whole.write(folder / f"bag_{k}.mcap")
    log, said = converted(folder, tmp_path)
    whole.entries = entries
    assert (same(log, read_log(whole.write(tmp_path / "a.mcap"))), said) == (True, "")


def test_a_part_that_is_missing_is_named(tmp_path: Path) -> None:
    folder = ros2(ordinary_drive(), tmp_path / "bag", StoragePlugin.MCAP)
    text = (folder / "metadata.yaml").read_text()
    (folder / "metadata.yaml").write_text(text.replace("- bag.mcap", "- bag.mcap\n  - bag_1.mcap"))
    _, said = converted(folder, tmp_path)
    assert "metadata.yaml names bag_1.mcap, which is not here: read without" in said


def test_a_folder_of_several_recordings_is_no_bag(tmp_path: Path) -> None:
    for name in ("monday.mcap", "tuesday.mcap"):
        ordinary_drive().write(tmp_path / name)
    with pytest.raises(MclError, match="this folder is no bag"):
        convert([tmp_path], tmp_path / "out.mcap")


# --- recorders that were killed


def test_a_bag_of_ros_1_without_its_index(tmp_path: Path) -> None:
    whole = ros1(ordinary_drive(), tmp_path / "a.bag").read_bytes()
    index = whole.index(b"op=\x04")  # the first record after the chunk
    (tmp_path / "a.bag.active").write_bytes(whole[: index - 100])
    (tmp_path / "b.bag").write_bytes(whole[: index - 100] + b"\0" * 64)
    (tmp_path / "c.bag").write_bytes(whole[:-40])
    log = read_log(ordinary_drive().write(tmp_path / "a.mcap"))
    for name in ("c.bag",):
        cut, said = converted(tmp_path / name, tmp_path)
        assert same(cut, log)
        assert "read without its index, as far as it goes: its last" in said
    for name in ("a.bag.active", "b.bag"):
        with pytest.raises(MclError, match="cut or damaged"):  # within the only chunk
            converted(tmp_path / name, tmp_path)


@pytest.mark.parametrize("compression", [None, *Writer1.CompressionFormat])
def test_a_recorder_of_ros_1_that_was_killed(tmp_path: Path, compression) -> None:
    path, store = tmp_path / "a.bag", ros1_store()
    writer = Writer1(path)
    if compression is not None:
        writer.set_compression(compression)
    writer.chunk_threshold = 10_000
    with writer:
        topics = {}
        for topic, kind, stamp, _, data in ordinary_drive().entries:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=store)
            message = as_ros1(STORE.deserialize_cdr(data, kind), store)
            writer.write(topics[topic], stamp, store.serialize_ros1(message, kind))
    whole, base = path.read_bytes(), read_log(ordinary_drive().write(tmp_path / "a.mcap"))
    (tmp_path / "a.bag.active").write_bytes(whole[: len(whole) * 2 // 3])
    log, said = converted(tmp_path / "a.bag.active", tmp_path)
    assert 20 < len(log) < 60
    np.testing.assert_array_equal(log.ranges, base.ranges[: len(log)])
    np.testing.assert_allclose(log.odometry, base.odometry[: len(log)], atol=1e-12)
    assert "read without its index, as far as it goes: its last" in said


def test_a_database_that_is_cut(tmp_path: Path) -> None:
    folder = ros2(ordinary_drive(), tmp_path / "bag", StoragePlugin.SQLITE3)
    file = folder / "bag.db3"
    whole = file.read_bytes()
    lengths = []
    for share in (0.5, 0.7, 0.9):
        file.write_bytes(whole[: int(share * len(whole))])
        log, said = converted(folder, tmp_path)
        assert "cut or damaged: of its" in said
        lengths.append(len(log))
    assert 0 < lengths[0] < lengths[1] < lengths[2] <= 60
    file.write_bytes(whole[:3000])
    with pytest.raises(MclError, match="cut or damaged"):
        converted(folder, tmp_path)


def test_what_a_killed_recorder_left_beside_its_database(tmp_path: Path) -> None:
    folder = ros2(ordinary_drive(), tmp_path / "bag", StoragePlugin.SQLITE3)
    log, _ = converted(folder, tmp_path)
    database = sqlite3.connect(folder / "bag.db3")
    database.execute("PRAGMA journal_mode=WAL")
    rows = database.execute("SELECT topic_id, timestamp, data FROM messages WHERE id > 60").fetchall()
    database.execute("DELETE FROM messages WHERE id > 60")
    database.commit()
    database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    database.executemany("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
    database.commit()
    kept = (folder / "bag.db3-wal").read_bytes()
    file = (folder / "bag.db3").read_bytes()
    database.close()
    (folder / "bag.db3").write_bytes(file)
    (folder / "bag.db3-wal").write_bytes(kept)
    again, _ = converted(folder, tmp_path)
    assert same(again, log)


# --- clocks that were set back


@pytest.mark.parametrize("received", [False, True])
@pytest.mark.parametrize("kind", ["ros1", "sqlite", "mcap"])
def test_a_loop_in_a_bag_stays_in_the_order_of_the_file(tmp_path: Path, kind: str, received: bool) -> None:
    recording = looped(2, received)
    if kind == "ros1":
        path = ros1(recording, tmp_path / "a.bag")
    else:
        path = ros2(recording, tmp_path / "bag", PLUGINS[kind == "mcap"])
    log, said = converted(path, tmp_path)
    direct = read_log(recording.write(tmp_path / "a.mcap"))
    assert same(log, direct)
    assert log.stretches is not None
    np.testing.assert_array_equal(log.stretches, direct.stretches)
    assert "the stamps of /scan run back by" in said
