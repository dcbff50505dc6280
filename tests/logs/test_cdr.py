"""The bulk reading and writing of messages against rosbags, which has the last word on what CDR is."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pipeline.logs import cdr
from pipeline.logs.decode import decode_odometry, decode_scans
from pipeline.logs.recorded import Messages, Topic
from recordings import STORE, Recording

names = st.text(st.characters(codec="ascii", exclude_characters="\0"), min_size=1, max_size=20)


def as_messages(recording: Recording) -> Messages:
    _, kind, *_ = recording.entries[0]
    data = [entry[4] for entry in recording.entries]
    return Messages(Topic("/t", kind, "cdr", len(data)), np.arange(len(data)), np.arange(len(data)), data)


@given(names, names)
def test_odometry_with_frames_of_any_length(frame: str, child: str) -> None:
    recording = Recording()
    for i in range(3):
        recording.odometry(10**9 * i + i, 1.5 * i, -i, 0.1 * i, frames=(frame, child))
    messages = as_messages(recording)
    rows = cdr.unpack(messages.data, cdr.ODOMETRY)
    assert rows is not None
    columns = decode_odometry(messages)
    assert (columns.frame, columns.child_frame) == (frame, child)
    assert columns.stamps.tolist() == [0, 10**9 + 1, 2 * 10**9 + 2]
    np.testing.assert_allclose(columns.planar, [[1.5 * i, -i, 0.1 * i] for i in range(3)], atol=1e-15)


@given(names, st.integers(0, 9), st.integers(0, 9))
def test_scans_of_any_shape(frame: str, beams: int, intensities: int) -> None:
    recording = Recording()
    for i in range(3):
        recording.scan(i, np.arange(beams) + i, frame=frame, intensities=intensities)
    messages = as_messages(recording)
    assert cdr.unpack(messages.data, cdr.LASER_SCAN) is not None
    columns = decode_scans(messages)
    assert columns.frame == frame
    np.testing.assert_array_equal(columns.ranges, np.arange(3)[:, None] + np.arange(beams)[None, :])


@given(names, st.integers(1, 5))
def test_what_is_packed_is_what_rosbags_reads(frame: str, count: int) -> None:
    rows = cdr.blank(count, cdr.LASER_SCAN, {"ranges": 4}, frame_id=frame)
    rows["ranges"] = np.arange(count * 4).reshape(count, 4)
    rows["range_max"] = 7.0
    cdr.set_stamps(rows, 1_500_000_000 * np.arange(count))
    for i, data in enumerate(cdr.pack(rows)):
        message = STORE.deserialize_cdr(data, "sensor_msgs/msg/LaserScan")
        assert message.header.frame_id == frame
        assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == 1_500_000_000 * i
        assert message.range_max == 7.0
        assert message.ranges.tolist() == [4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 3]
        assert bytes(STORE.serialize_cdr(message, "sensor_msgs/msg/LaserScan")) == data


texts = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=12)


@given(st.integers(0, 2**31 * 10**9 - 1), st.integers(0, 3), texts, texts, st.dictionaries(texts, texts, max_size=4))
def test_diagnostics_of_any_texts_are_what_rosbags_reads(
    stamp: int, level: int, name: str, message: str, values: dict[str, str]
) -> None:
    data, kind = cdr.pack_diagnostics(stamp, level, name, message, values), "diagnostic_msgs/msg/DiagnosticArray"
    found = STORE.deserialize_cdr(data, kind)
    assert found.header.stamp.sec * 10**9 + found.header.stamp.nanosec == stamp
    (status,) = found.status
    assert (status.level, status.name, status.message, status.hardware_id) == (level, name, message, "")
    assert {pair.key: pair.value for pair in status.values} == values
    assert bytes(STORE.serialize_cdr(found, kind)) == data
    assert cdr.stamp_of(data) == stamp


def test_messages_of_different_shapes_are_left_to_rosbags() -> None:
    frames = Recording()
    for frame in ("one", "two"):  # the same length, so that only a look at the bytes tells them apart
        frames.odometry(0, 0.0, 0.0, 0.0, frames=(frame, "base"))
    assert cdr.unpack(as_messages(frames).data, cdr.ODOMETRY) is None
    shapes = Recording()
    for beams in (4, 5):
        shapes.scan(0, np.arange(beams))
    assert cdr.unpack(as_messages(shapes).data, cdr.LASER_SCAN) is None
    swapped = Recording()  # ranges and intensities change places: the same number of bytes in all
    swapped.scan(0, np.arange(3), intensities=5)
    swapped.scan(0, np.arange(5), intensities=3)
    assert cdr.unpack(as_messages(swapped).data, cdr.LASER_SCAN) is None


@given(st.binary(max_size=200))
def test_bytes_that_are_no_message(data: bytes) -> None:
    for fields in (cdr.LASER_SCAN, cdr.ODOMETRY, cdr.POSE_STAMPED, cdr.ONE_TRANSFORM):
        rows = cdr.unpack([data, data], fields)
        assert rows is None or len(rows) == 2


def test_padding_at_the_end_is_tolerated_and_big_endian_is_not() -> None:
    recording = Recording()
    recording.scan(5, np.arange(3))
    data = recording.entries[0][4]
    assert cdr.unpack([data + b"\0\0"], cdr.LASER_SCAN) is not None
    assert cdr.unpack([data + b"\0\0\0\0"], cdr.LASER_SCAN) is None
    assert cdr.unpack([b"\0\0" + data[2:]], cdr.LASER_SCAN) is None
