"""How a viewer draws what a log holds: messages about the picture, beside those about the robot.

Nobody knows where the odometry is in the map before the robot is found, and no transform says so. A viewer that draws
all in one scene wants one: it gets the odometry put beside the map, on a topic of its own that nobody navigates by.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.logs import schema
from pipeline.logs.columns import PoseColumns
from pipeline.logs.decode import typestore
from pipeline.logs.encode import Messages, static_message, transform_messages
from pipeline.maps.occupancy_grid import OccupancyGrid

GAP = 5.0  # metres between the map and the odometry
RADIUS, HEADING, HEIGHT = 0.3, 1.0, 0.05  # of what stands for the robot, metres
AROUND = 5.0  # metres that the scans of a robot without odometry are given on every side
STRIDE = 0.5  # metres between the points of a path
_FLOAT32 = 7  # as PointField calls it


def display_messages(
    odometry: PoseColumns | None, grid: OccupancyGrid | None, truth: PoseColumns | None, *, start: int, first_scan: int
) -> dict[str, Messages | None]:
    """Messages by topic: from ``start`` on, ns, where map and odometry are drawn; from ``first_scan`` on the robot and
    its path, and both where they truly were. Without odometry, the robot itself is drawn beside the map."""
    found: dict[str, Messages | None] = {}
    if odometry is None:
        mover, points = schema.BASE_FRAME, np.array([[-AROUND, -AROUND], [AROUND, AROUND]])
        found[schema.VIEW_ROBOT] = _cloud(mover, _robot(), first_scan)
    else:
        mover, points = odometry.frame, odometry.positions[:, :2]
        first = max(first_scan, int(odometry.stamps.min()))  # before it nothing is known of the robot, nor found out
        found[schema.VIEW_ROBOT] = _cloud(odometry.child_frame, _robot(), first)
        found[schema.VIEW_PATH] = _cloud(mover, _path(odometry), first)
    frames = {schema.MAP_FRAME} if grid is not None else set()
    corners = [] if grid is None else [_corners(grid)]
    if truth is not None:
        frames.add(truth.frame)
        corners.append(truth.positions[:, :2])
        first = int(truth.stamps.min())
        found[schema.VIEW_TRUE_TF] = transform_messages(truth)
        found[schema.VIEW_TRUE_ROBOT] = _cloud(truth.child_frame, _robot(), first)
        found[schema.VIEW_TRUE_PATH] = _cloud(truth.frame, _path(truth), first)
    if frames - {mover}:
        beside = _beside(points, np.concatenate(corners))
        places = {mover: beside} | dict.fromkeys(sorted(frames), (0.0, 0.0, 0.0))
        links = [static_message(frame, schema.VIEW_FRAME, place, start) for frame, place in places.items()]
        stamps, sequences = np.full(len(links), start), np.zeros(len(links), np.int64)
        found[schema.VIEW_TF] = (stamps, sequences, [data for _, _, (data,) in links])
    return found


def _beside(points: NDArray[np.float64], others: NDArray[np.float64]) -> tuple[float, float, float]:
    """Where to put points (n, 2) to have them to the right of others (m, 2), halfway up."""
    x = others[:, 0].max() + GAP - points[:, 0].min()
    y = (others[:, 1].min() + others[:, 1].max() - points[:, 1].min() - points[:, 1].max()) / 2
    return float(x), float(y), 0.0


def _corners(grid: OccupancyGrid) -> NDArray[np.float64]:
    width, height = grid.width * grid.resolution, grid.height * grid.resolution
    corners: NDArray[np.float64] = grid.to_map([(0, 0, 0), (width, 0, 0), (0, height, 0), (width, height, 0)])[:, :2]
    return corners


def _robot() -> NDArray[np.float64]:
    """A circle and a line ahead: (n, 2)."""
    turn = np.linspace(0.0, 2 * np.pi, 64, endpoint=False)
    ahead = np.linspace(0.0, HEADING, 32)
    return np.concatenate([RADIUS * np.column_stack([np.cos(turn), np.sin(turn)]), np.column_stack([ahead, 0 * ahead])])


def _path(poses: PoseColumns) -> NDArray[np.float64]:
    """A point every so many metres: (n, 2)."""
    points = poses.positions[np.argsort(poses.stamps, kind="stable"), :2]
    travelled = np.hypot(*np.diff(points, axis=0, prepend=points[:1]).T).cumsum()
    return points[np.unique(travelled // STRIDE, return_index=True)[1]]


def _cloud(frame: str, points: NDArray[np.float64], stamp: int) -> Messages:
    """Points (n, 2) as the only PointCloud2: no other shape is drawn by every viewer."""
    positions = np.full((len(points), 3), HEIGHT, "<f4")
    positions[:, :2] = points
    types = typestore().types
    time = types["builtin_interfaces/msg/Time"](*divmod(stamp, 1_000_000_000))
    fields = [types["sensor_msgs/msg/PointField"](name, 4 * i, _FLOAT32, 1) for i, name in enumerate("xyz")]
    cloud = types[schema.CLOUD_TYPE](
        types["std_msgs/msg/Header"](time, frame),
        height=1, width=len(points), fields=fields, is_bigendian=False, point_step=12, row_step=positions.nbytes,
        data=np.frombuffer(positions.tobytes(), np.uint8), is_dense=True,
    )  # fmt: skip
    data = bytes(typestore().serialize_cdr(cloud, schema.CLOUD_TYPE))
    return np.array([stamp]), np.zeros(1, np.int64), [data]
