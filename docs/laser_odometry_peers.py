"""Laser odometry of other people beside ours, on the same scans: drift over 200 scans, the Freiburg metric, speed.

    python docs/laser_odometry_peers.py DATA [--log intel ...] [--scans N] [--all] [--json OUT.json]

DATA is the folder that holds ``carmen/NAME/`` with ``NAME.log.gz``, ``groundtruth.tum`` (of the laser) and
``NAME.relations``. The peers are no dependency: ``pip install kiss-icp small_gicp`` into the environment that runs
this; one that is not there is left out, with a line that says so. ``--scans 0`` takes whole logs, not their first 4,000
scans; ``--all`` runs every setting that was tried, not only each peer's best.

Both peers are made for three dimensions. KISS-ICP (point to point) takes a scan as points of height 0; voxels, ranges
and thresholds suit a building, it does not deskew, and it runs on one thread. small_gicp estimates how a surface lies
from a point's neighbours, and all points of height 0 lie on the floor: so every scan is given to it twice, one above
the other, which makes its walls walls. It matches two clouds, so the last key scans are kept for it here. Each peer is
started from going on as before, and from what the wheels say.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from converters import convert
from pipeline.evaluate.drift import Relations, drift, read_relations, relation_errors
from pipeline.evaluate.metrics import interpolate, laser_to_base
from pipeline.geometry import between, compose
from pipeline.logs.messages import Log, Trajectory
from pipeline.logs.reader import read_log
from pipeline.logs.tum import read_tum

Array = NDArray[np.float64]
LOGS = ("intel", "fr079", "aces")
SHORTEST, LONGEST = 0.15, 30.0
"""m: readings outside are given to nobody."""
INSTALL = {"kiss_icp": "kiss-icp", "small_gicp": "small_gicp"}


@dataclass(frozen=True)
class Setting:
    """One way to run a peer: a row of the table. ``best``: run without --all."""

    peer: str
    name: str
    make: Callable[[Log], Any]
    wheels: bool
    best: bool = False


@dataclass(frozen=True)
class Row:
    """What came of it: medians over 200 scans (m, degrees), the Freiburg metric (m, degrees), ms a scan."""

    log: str
    who: str
    position: float
    heading: float
    translation: tuple[float, float]
    rotation: tuple[float, float]
    relations: str
    milliseconds: float | None


# --- the peers ------------------------------------------------------------------------------------------------------


class Kiss:
    """KISS-ICP (Vizzo et al. 2023) with voxels of ``voxel`` m."""

    def __init__(self, voxel: float, threshold: float, motion: float) -> None:
        from kiss_icp.config import KISSConfig
        from kiss_icp.kiss_icp import KissICP

        config = KISSConfig()
        config.data.max_range, config.data.min_range, config.data.deskew = LONGEST, SHORTEST, False
        config.mapping.voxel_size = voxel
        config.registration.max_num_threads = 1
        config.adaptive_threshold.initial_threshold = threshold
        config.adaptive_threshold.min_motion_th = motion
        self._odometry = KissICP(config)

    def step(self, points: Array, guess: Array | None) -> Array:
        """The pose (3,) once points (n, 2) of the robot's frame are matched; ``guess``: the wheels' step (3,)."""
        if guess is not None:
            self._odometry.last_delta = _matrix(guess)
        self._odometry.register_frame(_flat(points), np.zeros(0))
        return _planar(self._odometry.last_pose)


class Gicp:
    """small_gicp (Koide 2024): every scan against the last key scans, by ``kind`` (GICP or PLANE_ICP)."""

    def __init__(self, kind: str, spacing: float, reach: float, keys: int = 12) -> None:
        self._kind, self._spacing, self._reach = kind, spacing, reach
        self._keys: deque[Array] = deque(maxlen=keys)
        self._pose, self._last, self._key = np.zeros(3), np.zeros(3), None
        self._target: Any = None

    def step(self, points: Array, guess: Array | None) -> Array:
        """As ``Kiss.step``."""
        import small_gicp

        if self._target is None:
            self._remember(points)
            return self._pose
        source, _ = self._prepared(points)
        target, tree = self._target
        start = _matrix(compose(self._pose, self._last if guess is None else guess))
        found = small_gicp.align(
            target, source, tree, start, registration_type=self._kind, max_correspondence_distance=self._reach,
            num_threads=1, max_iterations=30,
        )  # fmt: skip
        pose = _planar(found.T_target_source)
        self._last, self._pose = between(self._pose, pose), pose
        moved = between(self._key, pose)
        if np.hypot(*moved[:2]) > 0.25 or abs(moved[2]) > 0.2:
            self._remember(points)
        return pose

    def _remember(self, points: Array) -> None:
        self._key = self._pose
        self._keys.append(compose(self._pose, np.column_stack([points, np.zeros(len(points))]))[:, :2])
        self._target = self._prepared(np.vstack(self._keys))

    def _prepared(self, points: Array) -> Any:
        import small_gicp

        layers = [np.column_stack([points, np.full(len(points), z * self._spacing)]) for z in (-0.5, 0.5)]
        return small_gicp.preprocess_points(
            np.vstack(layers), downsampling_resolution=self._spacing, num_neighbors=10, num_threads=1
        )


def _kiss(voxel: float, threshold: float = 0.5, motion: float = 0.05) -> Callable[[Log], Any]:
    return lambda _: Kiss(voxel, threshold, motion)


def _gicp(kind: str, spacing: float, reach: float) -> Callable[[Log], Any]:
    return lambda _: Gicp(kind, spacing, reach)


SETTINGS = [
    Setting("kiss_icp", "KISS-ICP, 0.1 m", _kiss(0.1), wheels=False),
    Setting("kiss_icp", "KISS-ICP, 0.2 m", _kiss(0.2), wheels=False, best=True),
    Setting("kiss_icp", "KISS-ICP, 0.5 m", _kiss(0.5), wheels=False),
    Setting("kiss_icp", "KISS-ICP, 0.1 m, from the wheels", _kiss(0.1), wheels=True),
    Setting("kiss_icp", "KISS-ICP, 0.2 m, from the wheels", _kiss(0.2), wheels=True, best=True),
    Setting("kiss_icp", "KISS-ICP, 0.5 m, from the wheels", _kiss(0.5), wheels=True),
    Setting("small_gicp", "small_gicp, GICP, 0.05 m", _gicp("GICP", 0.05, 0.5), wheels=False, best=True),
    Setting("small_gicp", "small_gicp, GICP, 0.1 m", _gicp("GICP", 0.1, 1.0), wheels=False),
    Setting("small_gicp", "small_gicp, point to plane, 0.05 m", _gicp("PLANE_ICP", 0.05, 0.5), wheels=False),
    Setting(
        "small_gicp", "small_gicp, GICP, 0.05 m, from the wheels", _gicp("GICP", 0.05, 0.5), wheels=True, best=True
    ),
    Setting("small_gicp", "small_gicp, GICP, 0.1 m, from the wheels", _gicp("GICP", 0.1, 1.0), wheels=True, best=True),
    Setting(
        "small_gicp", "small_gicp, point to plane, 0.05 m, from the wheels", _gicp("PLANE_ICP", 0.05, 0.5), wheels=True
    ),
]


# --- what is measured -----------------------------------------------------------------------------------------------


def main() -> None:
    """Run what was asked for, print the table, and write it as JSON if a file is named."""
    asked = _asked()
    settings = [setting for setting in SETTINGS if asked.all or setting.best]
    for peer, package in INSTALL.items():
        if find_spec(peer) is None:
            print(f"{peer} is not installed and is left out: pip install {package}", file=sys.stderr)
            settings = [setting for setting in settings if setting.peer != peer]
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        for name in asked.log or LOGS:
            source = asked.data / "carmen" / name
            convert([source / f"{name}.log.gz"], Path(folder) / f"{name}.mcap")
            log = _first(read_log(Path(folder) / f"{name}.mcap"), asked.scans)
            judge = Judge(log, read_tum(source / "groundtruth.tum"), read_relations(source / f"{name}.relations"))
            for row in _rows(judge, settings):
                print(f"{row.log}: {row.who}: {row.position:.3f} m, {row.heading:.2f} deg", file=sys.stderr, flush=True)
                rows.append(row)
    print(table(rows))
    if asked.json is not None:
        asked.json.write_text(json.dumps([asdict(row) for row in rows], indent=2) + "\n", encoding="utf-8")


def _asked() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("data", type=Path, metavar="DATA", help="The folder that holds carmen/.")
    parser.add_argument("--log", action="append", choices=LOGS, help="Only this log; may be given several times.")
    parser.add_argument("--scans", type=int, default=4000, metavar="N", help="Of each log its first N; 0: all of it.")
    parser.add_argument("--all", action="store_true", help="Every setting that was tried, not each peer's best.")
    parser.add_argument("--json", type=Path, metavar="OUT.json", help="Also write the figures here.")
    return parser.parse_args()


class Judge:
    """Scores dead-reckoned poses of a log's robot against the truth of its laser."""

    def __init__(self, log: Log, truth: Trajectory, relations: Relations) -> None:
        self.log, self._relations = log, relations
        self._truth = interpolate(laser_to_base(truth, log.laser.pose), log.stamps)

    def row(self, who: str, poses: Array, milliseconds: float | None) -> Row:
        """The figures of poses (n, 3) of base_link."""
        log, found = self.log, drift(poses, self._truth).over_scans
        assert found is not None
        errors = relation_errors(log.stamps, compose(poses, log.laser.pose), self._relations)
        return Row(
            log.name, who, found.position, found.heading, (errors.translation.mean, errors.translation.std),
            (errors.rotation.mean, errors.rotation.std), f"{errors.used}/{errors.total}", milliseconds,
        )  # fmt: skip


def _rows(judge: Judge, settings: list[Setting]) -> Iterator[Row]:
    log = judge.log
    yield judge.row("wheels", log.odometry, None)
    yield from _ours(judge)
    points = [_points(log, ranges) for ranges in log.ranges]
    steps = between(log.odometry[:-1], log.odometry[1:])
    for setting in settings:
        odometry, poses, seconds = setting.make(log), np.zeros((len(log), 3)), 0.0
        for i, scan in enumerate(points):
            guess = steps[i - 1] if setting.wheels and i else None
            start = time.perf_counter()
            poses[i] = odometry.step(scan, guess)
            seconds += time.perf_counter() - start
        yield judge.row(setting.name, poses, 1e3 * seconds / len(log))


def _ours(judge: Judge) -> Iterator[Row]:
    """What `mcl odometry` would write, with the wheels and without."""
    if find_spec("pipeline.motion") is None:
        return
    from pipeline.config import load_config
    from pipeline.odometry import laser_odometry

    laser_odometry(_first(judge.log, 200), load_config())  # compiles
    for who, alone in (("ours, laser and wheels", False), ("ours, laser alone", True)):
        found = laser_odometry(judge.log, load_config(), alone=alone)
        yield judge.row(who, found.poses, 1e3 * float(np.mean(found.seconds)))


def _first(log: Log, scans: int) -> Log:
    scans = scans or len(log)
    return replace(log, stamps=log.stamps[:scans], odometry=log.odometry[:scans], ranges=log.ranges[:scans])


def _points(log: Log, ranges: NDArray[np.float32]) -> Array:
    """Ends of the beams of one scan in the robot's frame, (n, 2) m."""
    near = np.isfinite(ranges) & (ranges > SHORTEST) & (ranges < min(LONGEST, log.laser.range_max))
    angles, lengths = log.laser.angles[near], ranges[near].astype(np.float64)
    ends = np.column_stack([lengths * np.cos(angles), lengths * np.sin(angles), np.zeros(len(lengths))])
    return compose(log.laser.pose, ends)[:, :2]


def _flat(points: Array) -> Array:
    return np.column_stack([points, np.zeros(len(points))])


def _matrix(pose: Array) -> Array:
    matrix = np.eye(4)
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    matrix[:2, :2], matrix[:2, 3] = [[cos, -sin], [sin, cos]], pose[:2]
    return matrix


def _planar(matrix: Array) -> Array:
    return np.array([matrix[0, 3], matrix[1, 3], np.arctan2(matrix[1, 0], matrix[0, 0])])


def table(rows: list[Row]) -> str:
    """The rows in Markdown."""
    lines = [
        "| log | odometry | over 200 scans: m | deg | relations: m | deg | ms a scan |",
        "|-----|----------|------------------:|----:|-------------:|----:|----------:|",
    ]
    for row in rows:
        (t, dt), (r, dr) = row.translation, row.rotation
        speed = "-" if row.milliseconds is None else f"{row.milliseconds:.2f}"
        lines.append(
            f"| {row.log} | {row.who} | {row.position:.3f} | {row.heading:.2f} | {t:.3f} ± {dt:.3f} | "
            f"{r:.2f} ± {dr:.2f} | {speed} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
