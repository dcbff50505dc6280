"""CARMEN logs, as the robotics data sets of the 2000s come, into an .mcap.

Every scan becomes a /scan, a /laser_pose and an /odom message, the robot's pose being the one that CARMEN wrote into
the scan's own line; the messages' ``sequence`` is the line number. There ODOM lines are counted and left out: their
stamps and those of the scans disagree, and merged by stamp the robot would twitch to and fro. For raw scans, which say
no pose, it is where the ODOM lines have the robot at the scan's stamp.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from converters.carmen_text import REAR, CarmenLog, is_carmen_text, read_carmen
from converters.report import LEFT_OUT, ConversionReport
from converters.segments import Segment, to_metadata
from converters.text import sha256
from pipeline import __version__
from pipeline.errors import MclError
from pipeline.geometry import Pose, between, wrap_angle
from pipeline.logs import schema
from pipeline.logs.collect import FARTHEST_MOUNT
from pipeline.logs.columns import PoseColumns, ScanColumns, planar_poses
from pipeline.logs.disturbed import disturbed_columns
from pipeline.logs.faults import Fault, note
from pipeline.logs.messages import Trajectory
from pipeline.logs.odometry import continue_odometry, move
from pipeline.logs.recorded import Names
from pipeline.logs.stretches import as_record
from pipeline.logs.tum import read_tum
from pipeline.logs.writer import write_log

FORMAT = "carmen"
DESCRIPTION = "CARMEN log"

_PARAMS = {f"{kind}LASER{k}": f"laser{k}" for k in (3, 4, 5) for kind in ("RAW", "")}
"""Under which name PARAM lines tell of lasers that are neither in front nor behind."""
PARAMS = "carmen:params"
"""Metadata record of the log's PARAM lines."""
SICK_CODES = 81.83
"""m: 81.83, 81.87, 81.89 and 81.91 are the codes of a SICK laser for readings without return."""
MOUNT_TOLERANCE = 0.05
"""m, rad: a laser that moves farther than this on the robot is not one: the log's poses were corrected afterwards."""


def sniff(path: Path, head: bytes) -> bool:
    """Whether the file is a CARMEN log, by its first bytes, unpacked where it is packed with bzip2."""
    return not path.is_dir() and is_carmen_text(path, head)


def convert(
    sources: Sequence[Path],
    output: Path,
    *,
    map_path: Path | None = None,
    drop: Sequence[tuple[float, float]] = (),
    ground_truth: Path | None = None,
    names: Names | None = None,
    without_odometry: bool = False,
    faults: Sequence[Fault] = (),
    seed: int = 0,
) -> ConversionReport:
    """Writes ``output`` from one log; see ``converters.convert``. The first line that counts is the first scan.

    Without ``ground_truth``, TRUEPOS lines are the truth, where there are any.
    """
    if len(sources) != 1:
        raise MclError("CARMEN logs cannot be joined", "convert them one by one")
    source = sources[0]
    raw = read_carmen(source)
    remarks = list(raw.remarks)
    log, segments, begins = _arrange(raw, drop, source)
    given = None if names is None else names.laser_pose
    laser_pose, mount = _laser_pose(raw, source, remarks) if given is None else (given, "what was said of it")
    without_odometry |= not raw.wheels
    range_max = _range_max(raw)
    record = {
        "format": FORMAT,
        "converter": f"mcl-replay {__version__}",
        "files": json.dumps([source.name]),
        "sha256": json.dumps([sha256(source)]),
        "lines": str(sum(raw.counts.values())),
        "lines_by_type": json.dumps(raw.counts),
        "scans_from": raw.kind,
        "odometry_from": f"the robot's pose in the {raw.kind} lines"
        if raw.laser_poses is not None
        else "the ODOM lines",
        "stamps": "as in the file" if not raw.repaired else "the nearest that increase, in the order of the file",
        "stamps_repaired": str(raw.repaired),
        "dropped_scans": str(len(raw) - len(log)),
        "dropped_intervals_s": json.dumps([list(interval) for interval in drop]),
        "laser_pose": json.dumps(laser_pose),
        "laser_pose_from": mount,
        "range_max": f"{range_max:g}",
    }
    if len(segments) > 1:
        starts = np.searchsorted(log.lines, [segment.first_sequence for segment in segments[1:]])
        record["kidnapped_at"] = json.dumps(((log.stamps[starts] - log.stamps[0]) / 1e9).tolist())
    if without_odometry:
        record["odometry_from"] = LEFT_OUT if raw.wheels else "nobody: there are no ODOM lines"
    if remarks:
        record["remarks"] = json.dumps(remarks)
    metadata = {schema.SOURCE: record, schema.SEGMENTS: to_metadata(segments)}
    if len(begins) > 1:
        metadata[schema.STRETCHES] = as_record(begins)
    if raw.params:
        metadata[PARAMS] = raw.params
    grid = None
    if map_path is not None:
        from converters import read_map

        grid = read_map(map_path)
        metadata[schema.MAP_SOURCE] = {"file": Path(map_path).name, "sha256": sha256(map_path)}
    scans, wheels, lasers = _columns(log, segments, range_max)
    odometry = None if without_odometry else wheels
    scans, odometry, _, made = disturbed_columns(scans, odometry, None, faults, seed)
    if made:
        metadata[schema.FAULTS] = note(made)
    write_log(
        output,
        scans,
        odometry,
        laser_pose,
        grid=grid,
        ground_truth=read_tum(ground_truth) if ground_truth is not None else _truth(raw),
        laser_poses=None if without_odometry or made or raw.laser_poses is None else lasers,
        metadata=metadata,
    )
    return ConversionReport(
        format=FORMAT,
        lines=sum(raw.counts.values()),
        scans=len(scans),
        odometry=0 if odometry is None else len(odometry),
        dropped=len(raw) - len(log),
        duration=float(log.stamps[-1] - log.stamps[0]) / 1e9,
        output=output,
        size=output.stat().st_size,
        remarks=tuple(remarks),
        faults=[fault.text for fault in made],
    )


def _arrange(
    raw: CarmenLog, drop: Sequence[tuple[float, float]], source: Path
) -> tuple[CarmenLog, list[Segment], NDArray[np.int64]]:
    """The log without what is to be dropped, the stretches that are left, and when (ns) the clock began anew."""
    since = raw.stamps - raw.stamps[0]
    keep = np.ones(len(raw), dtype=np.bool_)
    for begin, end in drop:
        if not (math.isfinite(begin) and math.isfinite(end) and 0 <= begin <= end):
            raise MclError(f"an interval to drop must be 0 <= begin <= end in seconds, not {begin}..{end}")
        keep &= (since < round(begin * 1e9)) | (since > round(end * 1e9))
    if not keep.any():
        raise MclError("nothing is left: every scan lies in what is to be dropped", path=source)
    log = raw.take(keep)
    stretch = np.searchsorted(raw.restarts, np.arange(len(raw)), side="right")[keep]
    starts = [0, *(np.flatnonzero((np.diff(np.flatnonzero(keep)) > 1) | (np.diff(stretch) > 0)) + 1).tolist()]
    motions = continue_odometry(log.robot_poses, starts)
    shifts = [raw.shifts[stretch[s]] for s in starts]
    segments = [Segment(0, int(log.lines[s]), 0, t, m) for s, t, m in zip(starts, shifts, motions, strict=True)]
    return log, segments, raw.stamps[[0, *raw.restarts]]


def _columns(
    log: CarmenLog, segments: Sequence[Segment], range_max: float
) -> tuple[ScanColumns, PoseColumns, PoseColumns]:
    """What is written as /scan, /odom and /laser_pose."""
    robots = log.robot_poses.copy()
    lasers = robots.copy() if log.laser_poses is None else log.laser_poses.copy()
    which = np.searchsorted([s.first_sequence for s in segments], log.lines, side="right") - 1
    for k, segment in enumerate(segments):
        robots[which == k] = move(robots[which == k], segment.motion)
        lasers[which == k] = move(lasers[which == k], segment.motion)
    scans = ScanColumns(
        log.stamps,
        log.lines,
        log.ranges.astype(np.float32),
        angle_min=log.beams.angle_min,
        angle_increment=log.beams.angle_increment,
        range_min=0.0,
        range_max=range_max,
        frame=schema.LASER_FRAME,
    )
    odometry = planar_poses(log.stamps, log.lines, robots, schema.ODOM_FRAME, schema.BASE_FRAME)
    return scans, odometry, planar_poses(log.stamps, log.lines, lasers, schema.ODOM_FRAME)


def _laser_pose(log: CarmenLog, source: Path, remarks: list[str]) -> tuple[Pose, str]:
    """The laser in base_link, to the millimetre, and where that is from: the scans, or PARAM where they disagree."""
    if log.laser_poses is not None:
        mounts = between(log.robot_poses, log.laser_poses)
        # A laser that looks back: not from pi to -pi.
        mounts[:, 2] = mounts[0, 2] + wrap_angle(mounts[:, 2] - mounts[0, 2])
        median = np.median(mounts, axis=0)
        if np.abs(mounts - median).max() <= MOUNT_TOLERANCE:
            x, y, yaw = (round(float(value), 3) + 0.0 for value in median)  # + 0.0: no negative zero
            return (x, y, yaw), f"the {log.kind} lines' own laser poses (median)"
    rear = log.kind in REAR
    which = _PARAMS.get(log.kind, "rearlaser" if rear else "frontlaser")
    name = f"robot_{which}_offset"
    if (x_ahead := _param(log, name)) is not None:
        aside, turned = _param(log, f"robot_{which}_side_offset"), _param(log, f"robot_{which}_angular_offset")
        yaw = turned if turned is not None else math.pi if rear else 0.0
        return (x_ahead, aside or 0.0, yaw), f"PARAM {name}"
    if log.laser_poses is None:
        remarks.append(
            f"no PARAM {name}: the laser is taken to be at the robot's centre; --laser-pose says where it is"
        )
        return (0.0, 0.0, math.pi if rear else 0.0), "nobody"
    raise MclError(
        f"the laser moves on the robot, and no PARAM {name} says where it is",
        "a log whose poses were corrected afterwards? give the raw one, or --laser-pose X,Y,YAW",
        path=source,
    )


def _param(log: CarmenLog, name: str) -> float | None:
    """A PARAM line's number; None if there is none that is one."""
    try:
        value = float(log.params[name])
    except (KeyError, ValueError):
        return None
    return value if abs(value) <= FARTHEST_MOUNT else None


def _range_max(log: CarmenLog) -> float:
    """The longest range (m) that a reading can have and still be one; what is above came from no obstacle.

    What ROBOTLASER1 says, else below the code that the log uses for "no return": one of the SICK laser's, or a
    longest reading that stands out by occurring over ten times as often as the next.
    """
    if log.beams.max_range is not None:
        return log.beams.max_range - 0.01  # a reading of exactly the longest range is one without return
    values, counts = np.unique(log.ranges[~np.isnan(log.ranges)], return_counts=True)
    if values[-1] >= SICK_CODES:
        return SICK_CODES - 0.01
    if len(values) > 1 and counts[-1] > 10 * counts[-2]:
        return round(float(values[-1]) - 0.01, 3)
    return float(values[-1])


def _truth(log: CarmenLog) -> Trajectory | None:
    return Trajectory(log.truth_stamps, log.truth_poses) if len(log.truth_stamps) else None
