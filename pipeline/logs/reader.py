"""Reads a log: an .mcap by the contract in ``schema``, or a ROS 2 recording that somebody else made.

Four steps: raw messages (``mcap_file``), columns (``decode``), topics and frames found (``collect``), and here the Log:
the laser the right way up on the robot, ranges made uniform, odometry and gyroscope at the stamps of the scans.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.geometry import Pose
from pipeline.logs import schema
from pipeline.logs.beam_times import checked, sweeps_of
from pipeline.logs.choice import find
from pipeline.logs.collect import cleaned, collect, mark_no_return
from pipeline.logs.columns import ScanColumns
from pipeline.logs.decode import decode_grid, decode_poses
from pipeline.logs.gyroscope import turns_at
from pipeline.logs.mcap_file import McapFile
from pipeline.logs.messages import Laser, Log, Trajectory
from pipeline.logs.odometry import odometry_at
from pipeline.logs.recorded import Messages, Names
from pipeline.logs.stretches import Clock, begins_after, from_record, stretches_of
from pipeline.logs.writer import unpack_grid
from pipeline.maps.occupancy_grid import OccupancyGrid

_UPRIGHT = 0.9  # cosine of the largest tilt (26 deg) at which a laser still counts as horizontal


def read_log(path: Path | str, grid: OccupancyGrid | None = None, names: Names | None = None) -> Log:
    """The scans of the file in the order of their stamps, each with the odometry at its stamp.

    ``log.grid`` is ``grid`` if given, else the file's own map with all its digits, else its /map, else None.
    Ranges follow REP 117: NaN where invalid (0, NaN, below range_min), inf where nothing came back (above
    range_max). Odometry is the message with the scan's stamp (of several, the one with the scan's sequence
    number), else interpolated; scans outside its span are dropped, and ``log.metadata["reader"]``
    counts them; its "remarks" (JSON) are what else a user should know. A file without odometry has all of its scans,
    and zeros for it. ``names``: topics and frames to read where the file leaves a choice, and what it lacks. A file
    that is cut is read as far as it goes. Where stamps begin anew, a stretch begins, and is put behind the one before.
    Raises MclError for a file that is no MCAP, or lacks scans, odometry that ``names`` asks for, or the laser's place
    on the robot, and says what it has instead.
    """
    path = Path(path)
    with McapFile(path) as file:
        metadata = file.metadata()
        drive = collect(file, names, mend=schema.FAULTS not in metadata)  # those were made on purpose
        try:
            truth = _ground_truth(file.messages([schema.GROUND_TRUTH]).get(schema.GROUND_TRUTH), drive.clock)
            own = own_map(file, drive.origin["scan_topic"]) if grid is None else None
        except MclError as error:
            raise error if error.path else MclError(error.message, error.hint, path=path) from error
    scans = drive.scans if schema.SOURCE in metadata else mark_no_return(drive.scans)
    laser, ranges = _right_way_up(scans, drive.laser_in_base, path)
    order = np.argsort(scans.stamps, kind="stable")
    stamps, sequences, ranges = scans.stamps[order], scans.sequences[order], ranges[order]
    laser, wrong_times = checked(laser, stamps)
    odometry, sweeps = drive.odometry, None
    poses, inside = np.zeros((len(stamps), 3)), np.ones(len(stamps), np.bool_)
    if odometry is not None:
        poses, inside = odometry_at(stamps, sequences, odometry)
        sweeps = sweeps_of(laser, stamps[inside], poses[inside], odometry)
    turns = None if drive.gyroscope is None else turns_at(stamps[inside], drive.gyroscope, odometry)
    told = {"beam_times_unused": wrong_times} if wrong_times else {}
    if drive.gyroscope is not None and turns is None:
        told["imu_unused"] = "it says nothing at the scans' stamps"
    remarks = [*drive.remarks, *(own.remarks if own is not None else ())]
    if len(drive.clock.begins) > 1 or (names is not None and names.stamps == "log"):
        told["restamped"] = "yes"
    if remarks:
        told["remarks"] = json.dumps(remarks)
    metadata[schema.READER] = {**drive.origin, "scans_outside_odometry": str(int((~inside).sum())), **told}
    begins = drive.clock.begins
    if schema.STRETCHES in metadata:
        begins = from_record(metadata[schema.STRETCHES])
    stretches = stretches_of(stamps[inside], begins) if len(begins) > 1 else None
    if stretches is not None and schema.STRETCHES not in metadata:
        metadata[schema.READER]["kidnapped_at"] = json.dumps(begins_after(stamps[inside], stretches))
    with path.open("rb") as content:
        digest = hashlib.file_digest(content, "sha256").hexdigest()
    return Log(
        name=path.stem,
        path=path,
        sha256=digest,
        laser=laser,
        stamps=stamps[inside],
        odometry=poses[inside],
        ranges=ranges[inside],
        grid=own if grid is None else grid,
        ground_truth=truth,
        metadata=metadata,
        wheels=odometry is not None,
        sweeps=sweeps,
        turns=turns,
        stretches=stretches,
    )


def own_map(file: McapFile, scan_topic: str | None = None) -> OccupancyGrid | None:
    """The map that travels in a file: with all its digits if it has them, else its last /map; None if it has none.

    ``scan_topic``: a topic of the robot whose map is wanted, where there are several robots.
    """
    if (cells := file.attachment(schema.MAP_CELLS)) is not None:
        return unpack_grid(cells)
    topic = find(file, schema.GRID_TYPE, beside=scan_topic)
    return None if topic is None else decode_grid(file.messages([topic])[topic])


def _right_way_up(
    scans: ScanColumns, laser_in_base: NDArray[np.float64], path: Path
) -> tuple[Laser, NDArray[np.float32]]:
    """The laser with its beams counter-clockwise as seen from above, and the cleaned ranges in that order."""
    beams = scans.ranges.shape[1]
    upright = float(laser_in_base[2, 2])
    if abs(upright) < _UPRIGHT:
        tilt = np.degrees(np.arccos(np.clip(upright, -1, 1)))
        raise MclError(f"the laser is tilted by {tilt:.0f} degrees: not a horizontal scan", path=path)
    if beams == 0 or scans.angle_increment == 0.0:
        raise MclError("the scans have no beams, or no angle between them", path=path)
    yaw = float(np.arctan2(laser_in_base[1, 0], laser_in_base[0, 0]))
    pose: Pose = (float(laser_in_base[0, 3]), float(laser_in_base[1, 3]), yaw)
    ranges = cleaned(scans).ranges
    first, step = scans.angle_min, scans.angle_increment
    if upright < 0:  # seen from above, an upside-down laser turns the other way round its own x axis
        first, step = -first, -step
    pace = scans.time_increment
    if step < 0:
        first, step, ranges, pace = first + (beams - 1) * step, -step, ranges[:, ::-1], -pace
    laser = Laser(pose, first, step, beams, scans.range_min, scans.range_max, pace + 0.0)  # no negative zero
    return laser, np.ascontiguousarray(ranges)


def _ground_truth(messages: Messages | None, clock: Clock) -> Trajectory | None:
    if messages is None or messages.topic.type != schema.POSE_TYPE:
        return None
    poses = clock(decode_poses(messages))
    order = np.argsort(poses.stamps, kind="stable")
    return Trajectory(poses.stamps[order], poses.planar[order], poses.frame)
