"""Recordings as other people's ROS 2 nodes make them: serialised by rosbags, with frames and topics of any name."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
T = STORE.types
Quaternion = tuple[float, float, float, float]
UPRIGHT: Quaternion = (0.0, 0.0, 0.0, 1.0)
UPSIDE_DOWN: Quaternion = (1.0, 0.0, 0.0, 0.0)  # rolled by half a turn


def yaw(angle: float) -> Quaternion:
    return (0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2))


@dataclass
class Recording:
    """Messages on their way into a file: (topic, type, log time, sequence, bytes)."""

    entries: list[tuple[str, str, int, int, bytes]] = field(default_factory=list)

    def put(self, topic: str, kind: str, stamp: int, message: Any, sequence: int = 0) -> None:
        self.entries.append((topic, kind, stamp, sequence, bytes(STORE.serialize_cdr(message, kind))))

    def odometry(
        self,
        stamp: int,
        x: float,
        y: float,
        angle: float,
        *,
        sequence: int = 0,
        topic: str = "/robot/odometry",
        frames: tuple[str, str] = ("odom_combined", "base_footprint"),
    ) -> None:
        zero = T["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
        covariance = np.zeros(36)
        message = T["nav_msgs/msg/Odometry"](
            header=header(stamp, frames[0]),
            child_frame_id=frames[1],
            pose=T["geometry_msgs/msg/PoseWithCovariance"](pose=pose(x, y, yaw(angle)), covariance=covariance),
            twist=T["geometry_msgs/msg/TwistWithCovariance"](
                twist=T["geometry_msgs/msg/Twist"](linear=zero, angular=zero), covariance=covariance
            ),
        )
        self.put(topic, "nav_msgs/msg/Odometry", stamp, message, sequence)

    def scan(
        self,
        stamp: int,
        ranges: Sequence[float],
        *,
        first: float = -0.5,
        step: float = 0.25,
        limits: tuple[float, float] = (0.1, 10.0),
        frame: str = "hokuyo_link",
        topic: str = "/base/scan_front",
        sequence: int = 0,
        intensities: int = 0,
        time_increment: float = 0.001,
    ) -> None:
        f = np.float32
        message = T["sensor_msgs/msg/LaserScan"](
            header=header(stamp, frame),
            angle_min=f(first),
            angle_max=f(first + step * (len(ranges) - 1)),
            angle_increment=f(step),
            time_increment=f(time_increment),
            scan_time=f(0.1),
            range_min=f(limits[0]),
            range_max=f(limits[1]),
            ranges=np.array(ranges, dtype=np.float32),
            intensities=np.arange(intensities, dtype=np.float32),
        )
        self.put(topic, "sensor_msgs/msg/LaserScan", stamp, message, sequence)

    def imu(
        self,
        stamp: int,
        rates: tuple[float, float, float],
        *,
        frame: str = "imu_link",
        topic: str = "/imu/data",
        measured: bool = True,
    ) -> None:
        zero, nine = vector(0.0, 0.0, 0.0), np.zeros(9)
        unknown = np.array([-1.0, *[0.0] * 8])
        message = T["sensor_msgs/msg/Imu"](
            header=header(stamp, frame),
            orientation=quaternion(yaw(1.0)),
            orientation_covariance=nine,
            angular_velocity=vector(*rates),
            angular_velocity_covariance=nine if measured else unknown,
            linear_acceleration=zero,
            linear_acceleration_covariance=unknown,
        )
        self.put(topic, "sensor_msgs/msg/Imu", stamp, message)

    def transforms(
        self, *links: tuple[str, str, tuple[float, float, float], Quaternion], topic: str = "/tf_static"
    ) -> None:
        stamped = [
            T["geometry_msgs/msg/TransformStamped"](
                header=header(0, parent),
                child_frame_id=child,
                transform=T["geometry_msgs/msg/Transform"](
                    translation=vector(*translation), rotation=quaternion(rotation)
                ),
            )
            for parent, child, translation, rotation in links
        ]
        self.put(topic, "tf2_msgs/msg/TFMessage", 0, T["tf2_msgs/msg/TFMessage"](transforms=stamped))

    def grid(self, cells: np.ndarray, resolution: float, x: float, y: float, angle: float, stamp: int = 0) -> None:
        info = T["nav_msgs/msg/MapMetaData"](
            map_load_time=time(0),
            resolution=np.float32(resolution),
            width=cells.shape[1],
            height=cells.shape[0],
            origin=pose(x, y, yaw(angle)),
        )
        message = T["nav_msgs/msg/OccupancyGrid"](header=header(stamp, "map"), info=info, data=cells.reshape(-1))
        self.put("/map_server/map", "nav_msgs/msg/OccupancyGrid", stamp, message)

    def write(self, path: Path, *, summary: bool = True) -> Path:
        with path.open("wb") as file:
            writer = Writer(file, compression=CompressionType.ZSTD, use_statistics=summary, repeat_channels=summary)
            writer.start(profile="ros2", library="somebody else")
            channels: dict[str, int] = {}
            for topic, kind, stamp, sequence, data in self.entries:
                if topic not in channels:
                    text = STORE.generate_msgdef(kind, ros_version=2)[0].encode()
                    channels[topic] = writer.register_channel(
                        topic, "cdr", writer.register_schema(kind, "ros2msg", text)
                    )
                writer.add_message(channels[topic], log_time=stamp, publish_time=stamp, sequence=sequence, data=data)
            writer.finish()
        return path


def ordinary() -> Recording:
    """Ten scans of five beams at 10 Hz amid odometry at 20 Hz along x; the laser 0.2 m ahead, by way of base_link."""
    recording = Recording()
    recording.transforms(
        ("base_footprint", "base_link", (0.0, 0.0, 0.1), UPRIGHT),
        ("base_link", "hokuyo_link", (0.2, 0.0, 0.3), UPRIGHT),
        ("base_link", "camera", (0.1, 0.0, 0.3), UPRIGHT),
    )
    for i in range(21):
        recording.odometry(1_000_000_000 + i * 50_000_000, 0.1 * i, 0.0, 0.0)
    for i in range(10):
        recording.scan(1_010_000_000 + i * 100_000_000, [1.0, 2.0, 3.0, 4.0, 5.0 + i / 10])
    return recording


def time(stamp: int) -> Any:
    return T["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)


def header(stamp: int, frame: str) -> Any:
    return T["std_msgs/msg/Header"](stamp=time(stamp), frame_id=frame)


def vector(x: float, y: float, z: float) -> Any:
    return T["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)


def quaternion(q: Quaternion) -> Any:
    return T["geometry_msgs/msg/Quaternion"](x=q[0], y=q[1], z=q[2], w=q[3])


def pose(x: float, y: float, q: Quaternion) -> Any:
    return T["geometry_msgs/msg/Pose"](
        position=T["geometry_msgs/msg/Point"](x=x, y=y, z=0.0), orientation=quaternion(q)
    )


def link(recording: Recording, stamp: int, parent: str, child: str, x: float, angle: float = 0.0) -> None:
    """One transform on /tf."""
    stamped = T["geometry_msgs/msg/TransformStamped"](
        header=header(stamp, parent),
        child_frame_id=child,
        transform=T["geometry_msgs/msg/Transform"](translation=vector(x, 0.0, 0.0), rotation=quaternion(yaw(angle))),
    )
    recording.put("/tf", "tf2_msgs/msg/TFMessage", stamp, T["tf2_msgs/msg/TFMessage"](transforms=[stamped]))
