"""Transforms between frames: where the laser sits on the robot, and odometry that travels as odom -> base on /tf."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.geometry import Pose, compose
from pipeline.logs import schema
from pipeline.logs.columns import PoseColumns, planar_poses
from pipeline.logs.decode import decode_links
from pipeline.logs.recorded import Recorded, describe, shortened
from pipeline.logs.transforms_file import GivenTransform

MOUNT_TOLERANCE = 0.05
"""m, rad: what moves farther than this on the robot is not mounted on it."""

Matrix = NDArray[np.float64]
Links = Mapping[str, PoseColumns]


class Transforms:
    """The transforms of a recording; each frame hangs from one parent, the first that it is said to have.

    ``topics``: those to read, where some are of another robot; what the ones with the highest number say counts first.
    ``given``: static ones of somebody who knows them better than the recording.
    """

    def __init__(
        self, recorded: Recorded, topics: Mapping[str, int] | None = None, given: Sequence[GivenTransform] = ()
    ) -> None:
        self._recorded = recorded
        self._given = {one.child: _link(one) for one in given}
        self._topics = dict.fromkeys(recorded.topics, 0) if topics is None else topics
        self._remarks: dict[str, list[str]] = {}

    def __bool__(self) -> bool:
        return bool(self.static or self.moving)

    @cached_property
    def static(self) -> Links:
        """Links by child frame, as said once and for all (/tf_static, also below a namespace)."""
        return {**self._read(static=True), **self._given}

    @cached_property
    def moving(self) -> Links:
        """Links by child frame, as said again and again (/tf); those that are static are not repeated."""
        return {child: link for child, link in self._read(static=False).items() if child not in self.static}

    def place(self, frame: str, base: str, odom: str) -> Matrix | None:
        """``frame`` in ``base`` as a 4x4 matrix, along static links and where they do not reach along moving ones.

        The way goes by the nearest frame above both, which must be below ``odom``; None if there is none.
        Raises MclError if a moving link on the way really moves.
        """
        if frame == base:
            return np.eye(4)
        found = _along(self.static, frame, base, odom)
        if found is None and self.moving:
            found = _along({**self.moving, **self.static}, frame, base, odom)
            if found is not None:
                self._check_mounted(frame, base, odom)
        return found

    def base_below(self, odom: str, frame: str) -> str | None:
        """The frame that hangs from ``odom`` and carries ``frame``; None if the way up ends elsewhere."""
        for link in _upwards({**self.moving, **self.static}, frame):
            if link.frame == odom:
                return link.child_frame
        return None

    def root(self, frame: str) -> str:
        """The highest frame that carries ``frame`` and does not move on what it is mounted on: the robot's own.

        The way up ends below a link that moves, and below frames called map, world or odom.
        """
        for link in _upwards({**self.moving, **self.static}, frame):
            if _fixed(link.frame) or (link.child_frame in self.moving and _moves(link)):
                break
            frame = link.frame
        return frame

    def knows(self, frame: str) -> bool:
        """Whether any link leads up from a frame or down from it."""
        links = {**self.moving, **self.static}
        return frame in links or any(link.frame == frame for link in links.values())

    def tells_odometry(self, frame: str) -> bool:
        """Whether something among the moving links is, or may be, the odometry: above ``frame``, or by its name."""
        way = [link for link in _upwards({**self.moving, **self.static}, frame) if link.child_frame in self.moving]
        return any(map(_moves, way)) or any("odom" in link.frame.lower() for link in self.moving.values())

    def odometry(self, frame: str, odom: str | None = None) -> PoseColumns:
        """The link above ``frame`` that is the odometry: from ``odom``, from a frame named so, or the one that moves.

        Raises MclError if there is none, or several.
        """
        way = [link for link in _upwards({**self.moving, **self.static}, frame) if link.child_frame in self.moving]
        if odom is not None:
            found = [link for link in way if link.frame == odom]
        else:
            found = [link for link in way if "odom" in link.frame.lower()][:1] or [link for link in way if _moves(link)]
        if len(found) == 1:
            return found[0]
        raise MclError(
            f"no odometry ({schema.ODOMETRY_TYPE}, or {odom or 'odom'} -> {frame} on /tf) in this file: "
            f"{describe(self._recorded.topics)}; {self.describe()}",
            "--odom-topic, --odom-frame and --base-frame choose",
            path=self._recorded.path,
        )

    def remarks(self, *frames: str) -> list[str]:
        """What a user should know of the transforms above these frames, as far as somebody has asked for them."""
        read: dict[str, Links] = vars(self)  # where cached properties are kept: /tf is long, and often nobody needs it
        links = {**read.get("moving", {}), **read.get("static", {})}
        children = [child for frame in frames for child in (frame, *(link.frame for link in _upwards(links, frame)))]
        said = [said for child in dict.fromkeys(children) for said in self._remarks.get(child, [])]
        if self._given and not self._given.keys() & set(children):
            named = shortened(sorted(self._given), "frames")
            said.append(f"--tf places {named}, and none of these is {frames[0]!r} or carries it: it has no effect")
        return said

    def describe(self) -> str:
        """Which links there are, for an error message."""
        links = {**self.moving, **self.static}.values()
        listed = sorted(f"{link.frame} -> {link.child_frame}" for link in links)
        return "it has " + (shortened(listed, "transforms") if listed else "no transforms")

    def _check_mounted(self, frame: str, base: str, odom: str) -> None:
        links = {**self.moving, **self.static}
        ways = [{link.child_frame: link for link in _upwards(links, f, odom)} for f in (frame, base)]
        for child in ways[0].keys() ^ ways[1].keys():
            if child in self.moving and _moves(self.moving[child]):
                raise MclError(
                    f"{frame!r} moves on the robot: {self.moving[child].frame} -> {child} changes on the way",
                    path=self._recorded.path,
                )

    def _read(self, *, static: bool) -> Links:
        names = [
            topic.name
            for topic in self._recorded.topics.values()
            if topic.type == schema.TF_TYPE and topic.encoding == schema.MESSAGE_ENCODING
            if topic.name.endswith("tf_static") == static and topic.name not in schema.VIEW_TRANSFORMS
            if topic.name in self._topics
        ]
        links: dict[str, PoseColumns] = {}
        read = self._recorded.messages(names) if names else {}
        for name in sorted(read, key=lambda name: -self._topics[name]):
            found, remarks = decode_links(read[name], static=static)
            links = found | links
            for child, said in remarks.items():
                self._remarks.setdefault(child, []).extend(said)
        return links


def moved(odometry: PoseColumns, base: str, base_in_child: Matrix) -> PoseColumns:
    """The odometry of another frame of the same robot, given in the one that it moved before."""
    poses = compose(odometry.planar, planar(base_in_child))
    return replace(
        planar_poses(odometry.stamps, odometry.sequences, poses, odometry.frame, base),
        positions=np.column_stack([poses[:, :2], odometry.positions[:, 2] + base_in_child[2, 3]]),
        stretch=odometry.stretch,
        remarks=odometry.remarks,
    )


def in_space(pose: Pose) -> Matrix:
    """The 4x4 matrix of a pose in the plane."""
    x, y, yaw = pose
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0, x], [s, c, 0.0, y], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def planar(matrix: Matrix) -> NDArray[np.float64]:
    """What a 4x4 matrix does in the plane: x, y, yaw."""
    return np.array([matrix[0, 3], matrix[1, 3], np.arctan2(matrix[1, 0], matrix[0, 0])])


def to_quaternion(matrix: Matrix) -> NDArray[np.float64]:
    """The quaternion x, y, z, w of a 4x4 matrix's rotation; its largest component is positive."""
    m = matrix
    a, b, c = np.diag(m)[:3]
    # Four times the squares of the components: by the largest of them, nothing is divided by a small number.
    squares = [1 + a - b - c, 1 - a + b - c, 1 - a - b + c, 1 + a + b + c]
    xy, xz, yz = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    xw, yw, zw = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    k = int(np.argmax(squares))
    rows = [[squares[0], xy, xz, xw], [xy, squares[1], yz, yw], [xz, yz, squares[2], zw], [xw, yw, zw, squares[3]]]
    quaternion = np.array(rows[k]) / (2.0 * np.sqrt(squares[k]))
    result: NDArray[np.float64] = quaternion / np.linalg.norm(quaternion)
    return result


def _matrix(link: PoseColumns) -> Matrix:
    """The first of the link's transforms."""
    result = np.eye(4)
    x, y, z, w = link.orientations[0] / (np.linalg.norm(link.orientations[0]) or 1.0)  # never filled in: no turn
    result[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    result[:3, 3] = link.positions[0]
    return result


def _link(given: GivenTransform) -> PoseColumns:
    zero = np.zeros(1, np.int64)
    place, turn = np.array([given.position]), np.array([given.orientation])
    return PoseColumns(zero, zero, place, turn, given.parent, given.child)


def _along(links: Links, frame: str, base: str, odom: str) -> Matrix | None:
    above_frame, above_base = _ancestors(links, frame, odom), _ancestors(links, base, odom)
    for ancestor, matrix in above_frame.items():
        if ancestor in above_base:
            result: Matrix = np.linalg.inv(above_base[ancestor]) @ matrix
            return result
    return None


def _ancestors(links: Links, frame: str, odom: str) -> dict[str, Matrix]:
    """The frame seen from itself and every frame above it, nearest first, up to but without odom."""
    result = {frame: np.eye(4)}
    for link in _upwards(links, frame, odom):
        result[link.frame] = _matrix(link) @ result[link.child_frame]
    return result


def _upwards(links: Links, frame: str, odom: str | None = None) -> Iterator[PoseColumns]:
    """The links above a frame, nearest first, as far as they go without a circle, and not up to odom."""
    seen = {frame}
    while frame in links:
        link = links[frame]
        if link.frame in seen or link.frame == odom:
            return
        yield link
        frame = link.frame
        seen.add(frame)


def _fixed(frame: str) -> bool:
    """Whether a frame is called as the building or the odometry's origin is."""
    return "odom" in frame.lower() or frame.lower().rpartition("/")[2] in (schema.MAP_FRAME, "world")


def _moves(link: PoseColumns) -> bool:
    shifted = np.abs(link.positions - link.positions[0]).max()
    q = link.orientations / np.maximum(np.linalg.norm(link.orientations, axis=1, keepdims=True), 1e-9)
    turned = 2.0 * np.arccos(np.clip(np.abs(q @ q[0]), 0.0, 1.0)).max()
    return bool(max(shifted, turned) > MOUNT_TOLERANCE)
