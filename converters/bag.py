"""Bags of ROS 1 and ROS 2, and MCAP files by others, into an .mcap by our contract.

Scans, odometry and the laser's place are found as ``mcl localize`` finds them, and written as they were measured under
the contract's names of topics and frames. A pose that the bag's own localization published is no truth: it is taken for
one only if it is asked for.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from converters.bag_file import is_bag, open_recording
from converters.bag_truth import read_truth
from converters.map_files import read_map
from converters.report import LEFT_OUT, ConversionReport
from converters.segments import Segment, to_metadata
from converters.text import sha256
from pipeline import __version__
from pipeline.errors import MclError
from pipeline.logs import schema
from pipeline.logs.choice import find
from pipeline.logs.collect import Drive, collect, mark_no_return
from pipeline.logs.columns import GyroscopeColumns, PoseColumns, ScanColumns, planar_poses
from pipeline.logs.decode import decode_grid
from pipeline.logs.disturbed import disturbed_columns
from pipeline.logs.faults import Fault, note
from pipeline.logs.mcap_file import MAGIC, McapFile
from pipeline.logs.messages import Trajectory
from pipeline.logs.odometry import continue_odometry, move
from pipeline.logs.recorded import ByLogTime, Names, Recorded, no_topic
from pipeline.logs.stretches import as_record, begins_after, stretches_of
from pipeline.logs.tum import read_tum
from pipeline.logs.writer import write_log
from pipeline.maps.occupancy_grid import OccupancyGrid

FORMAT = "rosbag"
DESCRIPTION = "ROS bag"


def sniff(path: Path, head: bytes) -> bool:
    """Whether the path is a bag of ROS 1 or 2, or an .mcap that somebody else recorded."""
    if is_bag(path, head):
        return True
    if not head.startswith(MAGIC):
        return False
    with McapFile(path) as file:
        return schema.SOURCE not in file.metadata()


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
    """Writes ``output`` from one bag; see ``converters.convert``. ``drop`` counts from the first scan or odometry.

    ``ground_truth`` may also be a topic of the bag: of poses of the robot's centre in the map, or /tf for the way from
    the map to it. Without ``map_path`` the bag's own /map travels along.
    """
    if len(sources) != 1:
        raise MclError("bags cannot be joined", "convert them one by one")
    source = sources[0]
    with open_recording(source) as opened:
        recorded: Recorded = ByLogTime(opened) if names is not None and names.stamps == "log" else opened
        drive = collect(recorded, names)
        truth = None
        if ground_truth is not None:
            by_topic = str(ground_truth) in recorded.topics and not ground_truth.exists()
            truth = read_truth(recorded, str(ground_truth), drive) if by_topic else _truth_file(ground_truth, recorded)
        grid, map_record = _map(recorded, map_path, drive)
        remarks = (*drive.remarks, *(grid.remarks if grid is not None and map_path is None else ()))
    scans, odometry, segments, kidnapped = _arrange(drive, drop, source)
    lines = len(drive.scans) + (0 if drive.odometry is None else len(drive.odometry))
    dropped = lines - len(scans) - (0 if odometry is None else len(odometry))
    record = {
        "format": FORMAT,
        "converter": f"mcl-replay {__version__}",
        "files": json.dumps([file.name for file in _files(source)]),
        "sha256": json.dumps([sha256(file) for file in _files(source)]),
        "topics": json.dumps({name: [topic.type, topic.count] for name, topic in recorded.topics.items()}),
        **drive.origin,
        "dropped_messages": str(dropped),
        "dropped_intervals_s": json.dumps([list(interval) for interval in drop]),
    }
    if without_odometry and odometry is not None:
        record["odometry"], odometry = LEFT_OUT, None
    if ground_truth is not None:
        record["ground_truth_from"] = ground_truth.name if ground_truth.exists() else str(ground_truth)
    if len(drive.clock.begins) > 1:
        kidnapped = sorted({*kidnapped, *begins_after(scans.stamps, stretches_of(scans.stamps, drive.clock.begins))})
    if kidnapped:
        record["kidnapped_at"] = json.dumps(kidnapped)
    if remarks:
        record["remarks"] = json.dumps(remarks)
    metadata = {schema.SOURCE: record}
    if len(drive.clock.begins) > 1:
        metadata[schema.STRETCHES] = as_record(drive.clock.begins)
    if segments:
        metadata[schema.SEGMENTS] = to_metadata(segments)
    if map_record:
        metadata[schema.MAP_SOURCE] = map_record
    scans, odometry, gyroscope, made = disturbed_columns(scans, odometry, _gyroscope(drive, drop), faults, seed)
    if made:
        metadata[schema.FAULTS] = note(made)
    write_log(
        output,
        scans,
        odometry,
        drive.laser_in_base,
        grid=grid,
        ground_truth=truth,
        gyroscope=gyroscope,
        metadata=metadata,
    )
    ends = scans.stamps if odometry is None else np.concatenate([scans.stamps, odometry.stamps])
    return ConversionReport(
        format=FORMAT,
        lines=lines,
        scans=len(scans),
        odometry=0 if odometry is None else len(odometry),
        dropped=dropped,
        duration=float(ends.max() - ends.min()) / 1e9,
        output=output,
        size=output.stat().st_size,
        unit="messages",
        remarks=remarks,
        faults=[fault.text for fault in made],
    )


def _map(recorded: Recorded, path: Path | None, drive: Drive) -> tuple[OccupancyGrid | None, dict[str, str]]:
    """The map given, or the bag's own, and where it is from."""
    if path is not None:
        return read_map(path), {"file": Path(path).name, "sha256": sha256(path)}
    topic = find(recorded, schema.GRID_TYPE, beside=drive.origin["scan_topic"])
    if topic is None:
        return None, {}
    return decode_grid(recorded.messages([topic])[topic]), {"topic": topic}


def _truth_file(path: Path, recorded: Recorded) -> Trajectory:
    if not path.exists() and str(path).startswith("/") and not path.suffix:
        raise MclError(no_topic(str(path), recorded.topics), path=recorded.path)
    return read_tum(path)


def _arrange(
    drive: Drive, drop: Sequence[tuple[float, float]], source: Path
) -> tuple[ScanColumns, PoseColumns | None, list[Segment], list[float]]:
    """Scans and odometry in the order of their stamps under the contract's names, without what is to be dropped.

    Also the stretches that are left, and when (seconds since the first scan) all but the first of them begin.
    """
    scans = replace(mark_no_return(drive.scans), frame=schema.LASER_FRAME, resampled=0, stretch=None)
    scans = _scans_at(scans, np.argsort(scans.stamps, kind="stable"))
    start = _start(drive)
    kept_scans = np.flatnonzero(_kept(scans.stamps - start, drop))
    if drive.odometry is None:
        _check_left(kept_scans, source)
        scans = _scans_at(scans, kept_scans)
        resumed = np.flatnonzero(np.diff(kept_scans) > 1) + 1
        return scans, None, [], ((scans.stamps[resumed] - scans.stamps[0]) / 1e9).tolist()
    odometry = replace(drive.odometry, frame=schema.ODOM_FRAME, child_frame=schema.BASE_FRAME, stretch=None)
    odometry = _poses_at(odometry, np.argsort(odometry.stamps, kind="stable"))
    kept = np.flatnonzero(_kept(odometry.stamps - start, drop))
    _check_left(kept_scans, source)
    _check_left(kept, source)
    scans, odometry = _scans_at(scans, kept_scans), _poses_at(odometry, kept)
    starts = [0, *(np.flatnonzero(np.diff(kept) > 1) + 1).tolist()]
    planar = odometry.planar
    motions = continue_odometry(planar, starts)
    segments = [Segment(0, int(kept[s]), 0, 0, motion) for s, motion in zip(starts, motions, strict=True)]
    if len(starts) > 1:
        ends = [*starts[1:], len(planar)]
        parts = [move(planar[s:e], motion) for s, e, motion in zip(starts, ends, motions, strict=True)]
        moved = np.concatenate(parts)
        moved[:, 2] = np.mod(moved[:, 2] + np.pi, 2 * np.pi) - np.pi
        odometry = planar_poses(odometry.stamps, odometry.sequences, moved, odometry.frame, odometry.child_frame)
    kidnapped = [float(odometry.stamps[s] - scans.stamps[0]) / 1e9 for s in starts[1:]]
    return scans, odometry, segments, kidnapped


def _gyroscope(drive: Drive, drop: Sequence[tuple[float, float]]) -> GyroscopeColumns | None:
    """Its rates without what is to be dropped, under the contract's name of the frame."""
    if drive.gyroscope is None:
        return None
    keep = _kept(drive.gyroscope.stamps - _start(drive), drop)
    return GyroscopeColumns(drive.gyroscope.stamps[keep], drive.gyroscope.rates[keep]) if keep.any() else None


def _start(drive: Drive) -> int:
    """The first stamp of scans and odometry, from which intervals to drop are counted."""
    return int(min(columns.stamps.min() for columns in (drive.scans, drive.odometry) if columns is not None))


def _check_left(kept: NDArray[np.int64], source: Path) -> None:
    if len(kept) == 0:
        raise MclError("nothing is left: every scan lies in what is to be dropped", path=source)


def _kept(since: NDArray[np.int64], drop: Sequence[tuple[float, float]]) -> NDArray[np.bool_]:
    keep = np.ones(len(since), dtype=np.bool_)
    for begin, end in drop:
        if not (math.isfinite(begin) and math.isfinite(end) and 0 <= begin <= end):
            raise MclError(f"an interval to drop must be 0 <= begin <= end in seconds, not {begin}..{end}")
        keep &= (since < round(begin * 1e9)) | (since > round(end * 1e9))
    return keep


def _scans_at(scans: ScanColumns, rows: NDArray[np.int64]) -> ScanColumns:
    return replace(scans, stamps=scans.stamps[rows], sequences=rows, ranges=scans.ranges[rows])


def _poses_at(poses: PoseColumns, rows: NDArray[np.int64]) -> PoseColumns:
    return replace(
        poses,
        stamps=poses.stamps[rows],
        sequences=rows,
        positions=poses.positions[rows],
        orientations=poses.orientations[rows],
    )


def _files(source: Path) -> list[Path]:
    return sorted(file for file in source.iterdir() if file.is_file()) if source.is_dir() else [source]
