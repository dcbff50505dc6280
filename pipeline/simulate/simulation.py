"""A drive through a made-up building, written as somebody's raw log and map, with the truth beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from converters.beesoft import write_beesoft
from converters.cmu_text import NO_RETURN_CM, CmuLog, write_log_text
from pipeline.geometry import between, compose, wrap_angle
from pipeline.logs.messages import Trajectory
from pipeline.logs.tum import write_tum
from pipeline.simulate.building import Building
from pipeline.simulate.drive import drive, interpolate
from pipeline.simulate.mapping import draw_map
from pipeline.simulate.sensors import LASER_POSE, measure_odometry, measure_ranges
from pipeline.simulate.world import build_world, people_at

Array = NDArray[np.float64]

MICROSECOND = 1000  # nanoseconds: the raw format's stamps have six decimals
JITTER = 0.05  # standard deviation of the time between two readings, as a share of it


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


def simulate(building: Building, out_dir: Path, seed: int) -> SimulationReport:
    """Writes NAME.log.gz (O and L lines), NAME.dat.gz (a beesoft map) and NAME_truth.tum (the centre at every scan).

    NAME is the building's. The same building and seed give the same text. Raises MclError for a
    building that cannot stand and for a drive that never ends.
    """
    # One stream of random numbers each, so that a change to one part leaves the others as they were.
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(5)]
    clock, wheels, scan_clock, beams, survey = streams
    motion = drive(building.robot)
    grid = draw_map(building, build_world(building, mapped=True), survey)

    end = float(motion.times[-1])
    scan_stamps = _ticks(0.02, end, building.laser.rate, scan_clock)
    # Odometry goes on past the last scan, so that every scan's pose lies between two readings.
    stamps = _ticks(0.0, end + 2.0 / building.odometry.rate, building.odometry.rate, clock)
    odometry = measure_odometry(motion.at(stamps / 1e9), building.odometry, wheels)
    scan_odometry = interpolate(scan_stamps / 1e9, stamps / 1e9, odometry)
    truth = motion.at(scan_stamps / 1e9)
    ranges = _scans(building, scan_stamps, truth, beams)

    out_dir.mkdir(parents=True, exist_ok=True)
    report = SimulationReport(
        log=out_dir / f"{building.name}.log.gz",
        map=out_dir / f"{building.name}.dat.gz",
        ground_truth=out_dir / f"{building.name}_truth.tum",
        seed=seed,
        scans=len(scan_stamps),
        duration=end,
        distance=motion.length,
        **_odometry_errors(truth, scan_odometry),
    )
    write_log_text(report.log, _raw_log(stamps, odometry, scan_stamps, scan_odometry, ranges))
    write_beesoft(report.map, grid)
    write_tum(report.ground_truth, Trajectory(scan_stamps, np.column_stack([truth[:, :2], wrap_angle(truth[:, 2])])))
    return report


def _ticks(start: float, end: float, rate: float, rng: np.random.Generator) -> NDArray[np.int64]:
    """Stamps (n,) in ns from ``start`` to ``end`` (s), ``rate`` a second, never quite evenly."""
    count = int((end - start) * rate * 1.2) + 16
    intervals = np.maximum(rng.normal(1.0, JITTER, count), 0.2) / rate
    seconds = start + np.concatenate([[0.0], np.cumsum(intervals)])
    return np.rint(seconds[seconds <= end] * 1e6).astype(np.int64) * MICROSECOND


def _scans(building: Building, stamps: NDArray[np.int64], truth: Array, rng: np.random.Generator) -> Array:
    """Ranges (n, 180) in metres, inf = no return."""
    world = build_world(building, mapped=False)
    return np.stack(
        [
            measure_ranges(world, people_at(building.people, stamp / 1e9), pose, building.laser, rng)
            for stamp, pose in zip(stamps.tolist(), truth, strict=True)
        ]
    )


def _raw_log(
    stamps: NDArray[np.int64], odometry: Array, scan_stamps: NDArray[np.int64], scan_odometry: Array, ranges: Array
) -> CmuLog:
    """Both kinds of lines in the order of time, in the raw format's centimetres."""
    times = np.concatenate([stamps, scan_stamps])
    order = np.argsort(times, kind="stable")
    is_scan = np.arange(len(times)) >= len(stamps)
    return CmuLog(
        lines=np.arange(1, len(times) + 1),
        is_scan=is_scan[order],
        stamps=times[order],
        poses=_raw_poses(np.concatenate([odometry, scan_odometry])[order]),
        laser_poses=_raw_poses(compose(scan_odometry, LASER_POSE)),
        ranges=np.where(np.isinf(ranges), NO_RETURN_CM, np.rint(ranges * 100.0)),
    )


def _raw_poses(poses: Array) -> Array:
    # Adding 0.0 turns a negative zero, which would be written with its sign, into zero.
    return np.column_stack([poses[:, :2] * 100.0, wrap_angle(poses[:, 2])]).round(6) + 0.0


def _odometry_errors(truth: Array, odometry: Array) -> dict[str, float]:
    dead_reckoned = compose(truth[0], between(odometry[0], odometry[-1]))
    x, y, yaw = dead_reckoned - truth[-1]
    return {"odometry_error": float(np.hypot(x, y)), "odometry_yaw_error": abs(float(wrap_angle(yaw)))}
