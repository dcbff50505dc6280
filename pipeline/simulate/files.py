"""A simulated drive as files: somebody's raw log and map, or one .mcap and a map for ROS; the truth beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from converters.beesoft import write_beesoft
from converters.cmu_text import NO_RETURN_CM, CmuLog, write_log_text
from pipeline.errors import MclError
from pipeline.geometry import compose, wrap_angle
from pipeline.logs import schema
from pipeline.logs.columns import ScanColumns, planar_poses
from pipeline.logs.faults import Fault, noted
from pipeline.logs.tum import write_tum
from pipeline.logs.writer import write_log
from pipeline.maps.map_server import save_map
from pipeline.simulate.building import Building, Laser
from pipeline.simulate.simulation import Simulated, simulate_log, with_faults

Array = NDArray[np.float64]


class Format(StrEnum):
    """How a simulated log is written."""

    cmu = "cmu"
    mcap = "mcap"


@dataclass(frozen=True)
class SimulationReport:
    """What a simulation wrote, and how hard it is: metres, seconds, radians.

    ``odometry_error`` and ``odometry_yaw_error``: how far odometry, set right at the first scan, is off at the last.
    """

    log: Path
    map: Path
    ground_truth: Path
    seed: int
    scans: int
    duration: float
    distance: float
    odometry_error: float
    odometry_yaw_error: float
    format: Format = Format.cmu
    faults: Sequence[str] = ()


def simulate(
    building: Building, out_dir: Path, seed: int, format: Format | None = None, faults: Sequence[Fault] = ()
) -> SimulationReport:
    """Drives through the building and writes the log, the map, and NAME_truth.tum (the centre at every scan).

    NAME is the building's. As ``cmu`` NAME.log.gz (O and L lines) and NAME.dat.gz (a beesoft map); as ``mcap``
    NAME.mcap by the contract of ``schema``, which holds map and truth as well, and NAME.yaml with NAME.pgm. Without
    ``format`` it is cmu if that can hold what the robot measures. ``faults`` are made in the log, placed by the seed.
    The same building, seed and faults give the same text.
    Raises MclError for a building that cannot stand, a drive that never ends, and a laser or gyroscope that cmu lacks.
    """
    format = chosen_format(building, format, faults)
    made = with_faults(simulate_log(building, seed), faults)
    out_dir.mkdir(parents=True, exist_ok=True)
    names = output_names(building, format)
    log, grid, truth = (out_dir / name for name in (names[0], names[1], names[-1]))
    if format is Format.cmu:
        write_log_text(log, _raw_log(made))
        write_beesoft(grid, made.grid)
    else:
        write_mcap(made, log)
        save_map(made.grid, grid)
    write_tum(truth, made.ground_truth)
    error, yaw_error = made.odometry_errors
    return SimulationReport(
        log=log,
        map=grid,
        ground_truth=truth,
        seed=seed,
        scans=len(made.log),
        duration=float(made.motion.times[-1]),
        distance=made.motion.length,
        odometry_error=error,
        odometry_yaw_error=yaw_error,
        format=format,
        faults=[fault.text for fault in noted(made.log.metadata)],
    )


def output_names(building: Building, format: Format) -> Sequence[str]:
    """The names of the files that ``simulate`` writes: the log, the map (and its image), the truth."""
    ends = (".log.gz", ".dat.gz") if format is Format.cmu else (".mcap", ".yaml", ".pgm")
    return [f"{building.name}{end}" for end in (*ends, "_truth.tum")]


def chosen_format(building: Building, format: Format | None, faults: Sequence[Fault] = ()) -> Format:
    """The format to write: ``format``, or the raw one if that can hold what the robot measures, and no faults' note.

    Raises MclError if the raw format is wanted and cannot hold it.
    """
    reasons = _not_in_raw_format(building) + (["the note of the faults that were made"] if faults else [])
    if format is Format.cmu and reasons:
        raise MclError(f"the raw format cannot hold {', '.join(reasons)}", "use --format mcap")
    return format or (Format.mcap if reasons else Format.cmu)


def write_mcap(made: Simulated, path: Path) -> None:
    """Writes the log as one .mcap by the contract of ``schema``, the laser's beams in the order of their measurement.

    Raises MclError if it cannot be written.
    """
    laser = made.building.laser
    stamps = np.concatenate([made.odometry_stamps, made.log.stamps])
    sequences = np.empty(len(stamps), dtype=np.int64)
    sequences[np.argsort(stamps, kind="stable")] = np.arange(1, len(stamps) + 1)
    readings = len(made.odometry_stamps)
    scans = ScanColumns(
        made.log.stamps,
        sequences[readings:],
        made.ranges.astype(np.float32),
        angle_min=laser.angle_min,
        angle_increment=laser.angle_increment,
        range_min=0.0,
        range_max=laser.max_range,
        frame=schema.LASER_FRAME,
        time_increment=laser.time_increment,
    )
    poses = np.column_stack([made.odometry[:, :2], wrap_angle(made.odometry[:, 2])])
    write_log(
        path,
        scans,
        planar_poses(made.odometry_stamps, sequences[:readings], poses, schema.ODOM_FRAME, schema.BASE_FRAME),
        _mount(laser),
        grid=made.grid,
        ground_truth=made.ground_truth,
        gyroscope=made.gyroscope,
        scan_time=1.0 / laser.rate,
        metadata=made.log.metadata,
    )


def _not_in_raw_format(building: Building) -> list[str]:
    """What of the laser and the other sensors O and L lines have no place for."""
    laser, usual = building.laser, Laser()
    return [
        reason
        for reason, here in (
            (f"{laser.beams} beams", laser.beams != usual.beams),
            ("another field of view than 180 beams from -90 degrees in steps of 1", _looks_elsewhere(laser, usual)),
            (f"a laser at {list(laser.pose)}, not at {list(usual.pose)}", laser.pose != usual.pose),
            ("a laser upside down", laser.upside_down),
            ("a time_increment", laser.time_increment > 0.0),
            ("invalid readings", laser.invalid > 0.0),
            ("a gyroscope", building.imu is not None),
        )
        if here
    ]


def _looks_elsewhere(laser: Laser, usual: Laser) -> bool:
    same = laser.angle_min == usual.angle_min and laser.angle_increment == usual.angle_increment
    return laser.beams == usual.beams and not same


def _mount(laser: Laser) -> tuple[float, float, float] | Array:
    """The laser in base_link: in the plane, or the matrix of one that is turned over its x axis."""
    if not laser.upside_down:
        return laser.mount
    x, y, yaw = laser.mount
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.array([[cos, sin, 0.0, x], [sin, -cos, 0.0, y], [0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def _raw_log(made: Simulated) -> CmuLog:
    """Both kinds of lines in the order of time, in the raw format's centimetres."""
    times = np.concatenate([made.odometry_stamps, made.log.stamps])
    order = np.argsort(times, kind="stable")
    is_scan = np.arange(len(times)) >= len(made.odometry_stamps)
    return CmuLog(
        lines=np.arange(1, len(times) + 1),
        is_scan=is_scan[order],
        stamps=times[order],
        poses=_raw_poses(np.concatenate([made.odometry, made.scan_odometry])[order]),
        laser_poses=_raw_poses(compose(made.scan_odometry, made.building.laser.mount)),
        ranges=np.where(np.isinf(made.ranges), NO_RETURN_CM, np.rint(made.ranges * 100.0)),
    )


def _raw_poses(poses: Array) -> Array:
    # Adding 0.0 turns a negative zero, which would be written with its sign, into zero.
    return np.column_stack([poses[:, :2] * 100.0, wrap_angle(poses[:, 2])]).round(6) + 0.0
