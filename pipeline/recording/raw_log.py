"""A log as it was recorded, before anybody has found the robot: the map, and apart from it odometry and scans.

Without odometry the robot stands still there, and the scans are those of its own frame.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from pipeline.config import load_config
from pipeline.geometry import compose
from pipeline.logs.messages import Log
from pipeline.motion.faults import without_leaps
from pipeline.recording import documents, entities, palette
from pipeline.recording.blueprint import ASPECT, Area, framed, known_area, looking_down, map_view, so_far
from pipeline.recording.columns import lift, segments, timelines, transforms
from pipeline.recording.streams import opened, sending
from pipeline.recording.styles import drawn_map, robot
from pipeline.recording.truth import truth_at_scans

ODOMETRY = "/odometry"
PATH, ROBOT = f"{ODOMETRY}/path", f"{ODOMETRY}/robot"
LASER_PATH, LASER_ROBOT = f"{ODOMETRY}/laser_path", f"{ODOMETRY}/laser_robot"
SCAN = "scan"  # below a robot
MARGIN = 10.0  # metres around the path, for the scans
_dot, _line = rr.Radius.ui_points(1.5), rr.Radius.ui_points(1.0)


def write_raw_log(path: Path, log: Log) -> None:
    """Write a recording of the log."""
    _fill(rr.FileSink(path), log)


def send_raw_log(address: str, log: Log) -> None:
    """Show the log in the viewer at ``address``. Raises MclError if it takes nothing."""
    sending(address, lambda sink: _fill(sink, log))


def _fill(sink: Any, log: Log) -> None:
    with opened(sink, entities.LOG_ID, f"{log.name}-{log.sha256[:12]}", _layout(log)) as stream:
        everything = np.arange(len(log))
        unbroken = np.ones(len(log), np.bool_)
        path = PATH if log.wheels else None
        _drive(stream, log, everything, without_leaps(log.times, log.odometry), unbroken, (ROBOT, path), palette.WHEELS)
        _see(stream, log, everything, ROBOT)
        if log.wheels:
            poses, joined = _by_laser(log)
            _drive(stream, log, everything, poses, joined, (LASER_ROBOT, LASER_PATH), palette.LASER)
        if log.grid is not None:
            stream.log(entities.MAP, drawn_map(log.grid), static=True)
        truth = truth_at_scans(log)
        told = documents.log_explanation(grid=log.grid is not None, truth=truth is not None, wheels=log.wheels)
        markdown = rr.TextDocument(told, media_type=rr.MediaType.MARKDOWN)
        stream.log(entities.EXPLANATION, markdown, static=True)
        if truth is not None:
            _drive(stream, log, *truth, (entities.TRUTH, entities.TRUTH_PATH), palette.TRUTH)
            _see(stream, log, truth[0], entities.TRUTH)


def _by_laser(log: Log) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Where the robot was by its laser and its wheels, (n, 3), and where that goes on without a break, (n,)."""
    from pipeline.motion.witnesses import Witnesses

    witnesses = Witnesses(log.laser, load_config())
    heard = [witnesses.update(scan) for scan in log.scans()]
    stretches = np.array([0 if motion.laser is None else motion.laser.stretch for motion in heard])
    return np.array([motion.pose for motion in heard]), np.diff(stretches, prepend=stretches[0]) == 0


def _drive(
    stream: rr.RecordingStream,
    log: Log,
    scans: NDArray[np.int64],
    poses: NDArray[np.float64],
    joined: NDArray[np.bool_],
    places: tuple[str, str | None],
    colour: palette.Colour,
) -> None:
    """The robot at these poses (n, 3) of these scans (n,), and its path if it has one."""
    moving, path = places
    index = timelines(scans, log.times[scans])
    stream.send_columns(moving, index, transforms(poses, z=0.1))
    for entity, archetypes in robot(f"{moving}/body", f"{moving}/heading", colour).items():
        stream.log(entity, *archetypes, static=True)
    if path is not None:
        stream.send_columns(path, index, segments(poses, z=0.03, joined=joined))
        stream.log(path, rr.LineStrips3D.from_fields(radii=_line, colors=colour), static=True)


def _see(stream: rr.RecordingStream, log: Log, scans: NDArray[np.int64], moving: str) -> None:
    """What was measured at these scans (n,), as seen from the robot."""
    index = timelines(scans, log.times[scans])
    ranges = log.ranges[scans]
    returned = np.isfinite(ranges)
    rows, beams = np.nonzero(returned)
    angles, reach = log.laser.angles[beams], ranges[rows, beams]
    ends = np.column_stack([reach * np.cos(angles), reach * np.sin(angles), 0 * angles])
    points = lift(compose(np.array(log.laser.pose), ends)[:, :2], 0.0)
    stream.send_columns(
        f"{moving}/{SCAN}", index, rr.Points3D.columns(positions=points).partition(returned.sum(axis=1))
    )
    stream.log(f"{moving}/{SCAN}", rr.Points3D.from_fields(radii=_dot, colors=palette.HIT), static=True)


def _layout(log: Log) -> rrb.Blueprint:
    places = without_leaps(log.times, log.odometry)[:, :2]
    low, high = places.min(axis=0) - MARGIN, places.max(axis=0) + MARGIN
    area = Area(
        (float((low[0] + high[0]) / 2), float((low[1] + high[1]) / 2)),
        (float(high[0] - low[0]), float(high[1] - low[1])),
    )
    aspect = ASPECT if log.grid is None else ASPECT / 2
    views: list[rrb.View] = [
        rrb.Spatial3DView(
            origin=ODOMETRY,
            name="Odometry" if log.wheels else "Robot",
            contents=f"{ODOMETRY}/**",
            eye_controls=looking_down(area, aspect),
            line_grid=False,
            background=palette.UNKNOWN,
            overrides={PATH: so_far(), LASER_PATH: so_far()} if log.wheels else {},
        )
    ]
    if log.grid is not None:
        views.insert(0, map_view(known_area(log.grid), aspect=aspect))
    explanation = rrb.TextDocumentView(origin=entities.EXPLANATION, name="What you see")
    return framed(rrb.Vertical(rrb.Horizontal(*views), explanation, row_shares=[3, 1]))
