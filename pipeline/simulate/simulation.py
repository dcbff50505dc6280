"""A drive through a made-up building as a log in memory, with the truth beside it: no file is read or written."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline import __version__
from pipeline.errors import MclError
from pipeline.geometry import between, compose, wrap_angle
from pipeline.logs import schema
from pipeline.logs.columns import GyroscopeColumns
from pipeline.logs.disturbed import disturbed
from pipeline.logs.faults import Fault, placed, recorded, told
from pipeline.logs.messages import Laser, Log, Trajectory
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.simulate.building import Building
from pipeline.simulate.drive import Drive, drive, interpolate
from pipeline.simulate.mapping import draw_map
from pipeline.simulate.sensors import measure_odometry, measure_ranges, measure_turn_rates
from pipeline.simulate.world import build_world, people_at

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

FORMAT = "simulated"  # what mcl:source says of such a log
MICROSECOND = 1000  # nanoseconds: the raw format's stamps have six decimals
JITTER = 0.05  # standard deviation of the time between two readings, as a share of it


@dataclass(frozen=True)
class Simulated:
    """What a robot measured while it drove through a building, and what is true.

    ``log``: as ``read_log`` would give it of the .mcap that holds the same, with map and ground truth. ``motion``: the
    true motion at all times. ``odometry_stamps`` (m,) ns and ``odometry`` (m, 3), m and rad with unwrapped yaw: every
    reading of the wheels; ``scan_odometry`` (n, 3): the same at the scans' stamps. ``ranges`` (n, beams) float64 m:
    the beams as they were measured, inf = no return, NaN = no number. ``gyroscope``: its readings, if there is one.
    """

    building: Building
    seed: int
    log: Log
    motion: Drive
    odometry_stamps: Stamps
    odometry: Array
    scan_odometry: Array
    ranges: Array
    gyroscope: GyroscopeColumns | None

    @property
    def grid(self) -> OccupancyGrid:
        """The map that somebody made of the building."""
        assert self.log.grid is not None
        return self.log.grid

    @property
    def ground_truth(self) -> Trajectory:
        """Where the robot's centre was at the stamps of the scans."""
        assert self.log.ground_truth is not None
        return self.log.ground_truth

    @property
    def odometry_errors(self) -> tuple[float, float]:
        """How far odometry, set right at the first scan, is off at the last: m, rad."""
        truth = self.ground_truth.poses[np.searchsorted(self.ground_truth.stamps, self.log.stamps)]
        x, y, yaw = compose(truth[0], between(self.scan_odometry[0], self.scan_odometry[-1])) - truth[-1]
        return float(np.hypot(x, y)), abs(float(wrap_angle(yaw)))


def simulate_log(building: Building, seed: int = 0) -> Simulated:
    """Drives through the building: the same building and seed give the same numbers.

    Raises MclError for a building that cannot stand and for a drive that never ends.
    """
    # One stream of random numbers each, so that a change to one part leaves the others as they were; new ones are last.
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(8)]
    clock, wheels, scan_clock, beams, survey, gyroscope_clock, gyroscope_noise, lost = streams
    laser = building.laser
    motion = drive(building.robot)
    grid = draw_map(building, build_world(building, mapped=True), survey)

    end = float(motion.times[-1])
    scan_stamps = _ticks(0.02, end, laser.rate, scan_clock)
    # Odometry goes on past the last beam, so that every scan's pose lies between two readings.
    stamps = _ticks(0.0, end + laser.duration + 2.0 / building.odometry.rate, building.odometry.rate, clock)
    odometry = measure_odometry(motion.at(stamps / 1e9), building.odometry, wheels)
    scan_odometry = interpolate(scan_stamps / 1e9, stamps / 1e9, odometry)
    truth = motion.at(scan_stamps / 1e9)
    ranges = _scans(building, scan_stamps, motion, beams)
    if laser.invalid:
        ranges[lost.random(ranges.shape) < laser.invalid] = np.nan
    gyroscope = _gyroscope(building, motion, gyroscope_clock, gyroscope_noise)

    sweeps = None
    if laser.time_increment:
        last = interpolate(scan_stamps / 1e9 + laser.duration, stamps / 1e9, odometry)
        sweeps = between(scan_odometry, last)
    digest = hashlib.sha256(f"{building.model_dump_json()}\n{seed}".encode()).hexdigest()
    above, seen_from_above = _right_way_up(building, ranges)
    log = Log(
        name=building.name,
        path=Path(f"{building.name}.mcap"),
        sha256=digest,
        laser=above,
        stamps=scan_stamps,
        odometry=_wrapped(scan_odometry),
        ranges=seen_from_above,
        grid=grid,
        ground_truth=Trajectory(scan_stamps, _wrapped(truth)),
        metadata={
            schema.SOURCE: {
                "format": FORMAT,
                "converter": f"mcl-replay {__version__}",
                "building": building.name,
                "seed": str(seed),
                "sha256": digest,  # of the description and the seed
            }
        },
        sweeps=sweeps,
        turns=None if gyroscope is None else _turns(gyroscope, scan_stamps),
    )
    return Simulated(building, seed, log, motion, stamps, odometry, scan_odometry, ranges, gyroscope)


def with_faults(made: Simulated, faults: Sequence[Fault]) -> Simulated:
    """The same drive, measured by a robot with these faults; the seed places what they leave to chance.

    Raises MclError for a fault that lies outside of the drive, and for a jump.
    """
    if not faults:
        return made
    if any(fault.kind == "jump" for fault in faults):
        raise MclError("a jump sets scans of another time behind each other: only mcl evaluate can make it")
    disturbances = placed(faults, made.log.duration, made.seed)
    start, stamps, odometry, gyroscope = int(made.log.stamps[0]), made.odometry_stamps, made.odometry, made.gyroscope
    for fault in disturbances:
        times = (stamps - start) / 1e9
        kept = recorded(fault, times)
        odometry, stamps = told(fault, times, odometry)[kept], stamps[kept]
        if gyroscope is not None:
            kept = recorded(fault, (gyroscope.stamps - start) / 1e9)
            gyroscope = replace(gyroscope, stamps=gyroscope.stamps[kept], rates=gyroscope.rates[kept])
    log, rows = disturbed(made.log, disturbances)
    scan_odometry = interpolate(log.stamps / 1e9, stamps / 1e9, odometry)
    sweeps, laser = None, made.building.laser
    if laser.time_increment:
        sweeps = between(scan_odometry, interpolate(log.stamps / 1e9 + laser.duration, stamps / 1e9, odometry))
    return replace(
        made,
        log=replace(log, odometry=_wrapped(scan_odometry), sweeps=sweeps),
        odometry_stamps=stamps,
        odometry=odometry,
        scan_odometry=scan_odometry,
        ranges=made.ranges[rows],
        gyroscope=gyroscope,
    )


def _ticks(start: float, end: float, rate: float, rng: np.random.Generator) -> Stamps:
    """Stamps (n,) in ns from ``start`` to ``end`` (s), ``rate`` a second, never quite evenly."""
    count = int((end - start) * rate * 1.2) + 16
    intervals = np.maximum(rng.normal(1.0, JITTER, count), 0.2) / rate
    seconds = start + np.concatenate([[0.0], np.cumsum(intervals)])
    return np.rint(seconds[seconds <= end] * 1e6).astype(np.int64) * MICROSECOND


def _scans(building: Building, stamps: Stamps, motion: Drive, rng: np.random.Generator) -> Array:
    """Ranges (n, beams) in metres in the order in which they are measured, inf = no return."""
    world, laser = build_world(building, mapped=False), building.laser
    times = stamps / 1e9
    if laser.time_increment:
        times = times[:, None] + laser.time_increment * np.arange(laser.beams)
    return np.stack(
        [measure_ranges(world, people_at(building.people, when), motion.at(when), laser, rng) for when in times]
    )


def _gyroscope(
    building: Building, motion: Drive, clock: np.random.Generator, noise: np.random.Generator
) -> GyroscopeColumns | None:
    """Mean turn rates over the periods around the stamps, which is what such an instrument tells."""
    imu = building.imu
    if imu is None:
        return None
    end = float(motion.times[-1]) + building.laser.duration + 2.0 / imu.rate
    stamps = _ticks(0.0, end, imu.rate, clock)
    before, after = (motion.at(stamps / 1e9 + side * 0.5 / imu.rate)[:, 2] for side in (-1.0, 1.0))
    return GyroscopeColumns(stamps, measure_turn_rates(before, after, imu, noise), schema.IMU_FRAME)


def _turns(gyroscope: GyroscopeColumns, stamps: Stamps) -> Array:
    """The heading (n,) rad at ``stamps`` by the gyroscope's rates, 0 at its first reading."""
    times, rates = gyroscope.stamps / 1e9, gyroscope.rates
    heading = np.concatenate([[0.0], np.cumsum(np.diff(times) * (rates[:-1] + rates[1:]) / 2)])
    return np.interp(stamps / 1e9, times, heading)


def _right_way_up(building: Building, ranges: Array) -> tuple[Laser, NDArray[np.float32]]:
    """The laser and its ranges with beams that go counter-clockwise as seen from above, as every Log has them."""
    laser = building.laser
    first, increment, readings = laser.angle_min, laser.time_increment, ranges.astype(np.float32)
    if laser.upside_down:
        first = -(laser.angle_min + (laser.beams - 1) * laser.angle_increment)
        increment, readings = -increment, np.ascontiguousarray(readings[:, ::-1])
    x, y, yaw = laser.mount
    pose = (x, y, float(wrap_angle(yaw)))
    return Laser(pose, first, laser.angle_increment, laser.beams, 0.0, laser.max_range, increment), readings


def _wrapped(poses: Array) -> Array:
    return np.column_stack([poses[:, :2], wrap_angle(poses[:, 2])])
