"""The CMU course's O/L text logs and beesoft maps: into an .mcap, and every number back out of it.

Each line becomes an /odom message; an L line also a /scan and, so that nothing is lost, a /laser_pose. The
messages' ``sequence`` is the line number. What the messages cannot give back to the last digit (seven
decimals, turns beyond 2 pi) travels verbatim in an attachment, and so does a map that float32 would round.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from converters import beesoft
from converters.cmu_text import BEAMS, MAX_RANGE_CM, MAX_STAMP, CmuLog, format_lines, is_log_text, parse_log_text
from converters.map_files import HEAD, map_bytes, read_map
from converters.report import LEFT_OUT, ConversionReport
from converters.segments import Segment, from_metadata, move_back, to_metadata
from converters.text import read_log_bytes, sha256, write_text
from pipeline import __version__
from pipeline.errors import MclError
from pipeline.geometry import Pose, wrap_angle
from pipeline.logs import schema
from pipeline.logs.columns import PoseColumns, ScanColumns, planar_poses
from pipeline.logs.decode import decode_odometry, decode_poses, decode_scans
from pipeline.logs.disturbed import disturbed_columns
from pipeline.logs.faults import Fault, note
from pipeline.logs.mcap_file import McapFile
from pipeline.logs.odometry import continue_odometry, move
from pipeline.logs.recorded import Names
from pipeline.logs.stretches import GAP, as_record
from pipeline.logs.tum import read_tum
from pipeline.logs.writer import unpack_grid, write_log
from pipeline.maps.occupancy_grid import OccupancyGrid

FORMAT = "cmu"
DESCRIPTION = "CMU O/L text log"

DEFAULT_LASER_POSE: Pose = (0.25, 0.0, 0.0)  # what the course's instructions say
JOIN_GAP = 1_000_000_000  # ns between the last line of a log and the first of the one joined to it
VERBATIM_LINES = "cmu-lines.json.gz"
VERBATIM_MAP = "cmu-map.dat.gz"


def sniff(path: Path, head: bytes) -> bool:
    """Whether the file is an O/L log, by its first bytes."""
    return not path.is_dir() and is_log_text(head)


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
    """Writes ``output`` from one log, or from several one after the other; see ``converters.convert``."""
    read = [read_log_bytes(source) for source in sources]
    texts = [text for text, _ in read]
    logs = [parse_log_text(text, source, said) for (text, said), source in zip(read, sources, strict=True)]
    total = sum(map(len, logs))
    of_source = [f"{source.name}: " if len(sources) > 1 else "" for source in sources]
    remarks = tuple(source + said for log, source in zip(logs, of_source, strict=True) for said in log.remarks)
    truth = None if ground_truth is None else read_tum(ground_truth)
    grid, map_record, attachments = _read_map(map_path)

    log, segments, begins = _arrange(logs, drop, sources)
    laser_pose, measured = _laser_pose(log)
    laser_pose_from = "the log's own laser poses (median)" if measured else "the course's instructions"
    if names is not None and names.laser_pose is not None:
        laser_pose, laser_pose_from = names.laser_pose, "what was said of it"
    scans, odometry, lasers = _columns(log, segments)
    verbatim = _unfaithful_lines(_restore(scans, odometry, lasers, segments), segments, texts)
    given = None if without_odometry else odometry
    scans, given, _, made = disturbed_columns(scans, given, None, faults, seed)
    raw_kept = not without_odometry and not made  # what can give the source back
    if verbatim and raw_kept:
        attachments[VERBATIM_LINES] = gzip.compress(json.dumps(verbatim).encode(), mtime=0)
    record = {
        "format": FORMAT,
        "converter": f"mcl-replay {__version__}",
        "files": json.dumps([source.name for source in sources]),
        "sha256": json.dumps([sha256(source) for source in sources]),
        "sha256_unpacked": json.dumps([hashlib.sha256(text).hexdigest() for text in texts]),
        "lines": str(total),
        "odometry_lines": str(int((~log.is_scan).sum())),
        "scan_lines": str(int(log.is_scan.sum())),
        "dropped_lines": str(total - len(log)),
        "dropped_intervals_s": json.dumps([list(interval) for interval in drop]),
        "laser_pose": json.dumps(laser_pose),
        "laser_pose_from": laser_pose_from,
    }
    if len(segments) > 1:
        record["odometry"] = "goes on from where it stood across every gap: see mcl:segments for the source's own"
        starts = np.searchsorted(log.lines, [segment.first_sequence for segment in segments[1:]])
        record["kidnapped_at"] = json.dumps(((log.stamps[starts] - log.stamps[log.is_scan][0]) / 1e9).tolist())
    if without_odometry:
        record["odometry"] = LEFT_OUT
    if remarks:
        record["remarks"] = json.dumps(remarks)
    metadata = {schema.SOURCE: record, schema.SEGMENTS: to_metadata(segments)}
    if len(begins) > 1:
        metadata[schema.STRETCHES] = as_record(begins)
    if made:
        metadata[schema.FAULTS] = note(made)
    if map_record:
        metadata[schema.MAP_SOURCE] = map_record
    write_log(
        output,
        scans,
        given,
        laser_pose,
        grid=grid,
        ground_truth=truth,
        laser_poses=lasers if raw_kept else None,
        metadata=metadata,
        attachments=attachments,
    )
    return ConversionReport(
        format=FORMAT,
        lines=total,
        scans=len(scans),
        odometry=0 if given is None else len(given),
        dropped=total - len(log),
        duration=float(log.stamps[-1] - log.stamps[0]) / 1e9,
        output=output,
        size=output.stat().st_size,
        remarks=remarks,
        faults=[fault.text for fault in made],
    )


def export_raw(mcap: Path, log_out: Path, map_out: Path | None = None) -> list[Path]:
    """The raw text again, every number as it was: the log, and the map if ``map_out`` is given.

    Returns the paths of what was written. Of joined logs the second and later ones get ``-2``, ``-3``...
    in their names. Lines left out with ``drop`` are not in the .mcap and do not come back; the odometry of
    what follows is the source's own again.
    Raises MclError for an .mcap that was not made from such files.
    """
    with McapFile(mcap) as file:
        metadata = file.metadata()
        if file.remarks:
            raise MclError(file.remarks[0], path=mcap)
        if metadata.get(schema.SOURCE, {}).get("format") != FORMAT:
            raise MclError(f"not made from a {DESCRIPTION}: there is no raw log to give back", path=mcap)
        if schema.ODOMETRY not in file.topics:
            raise MclError("made without odometry: there is no raw log to give back", path=mcap)
        if schema.FAULTS in metadata:
            raise MclError("made with faults: there is no raw log to give back", path=mcap)
        messages = file.messages([schema.SCAN, schema.ODOMETRY, schema.LASER_POSE])
        lines_kept, map_kept = file.attachment(VERBATIM_LINES), file.attachment(VERBATIM_MAP)
        cells = file.attachment(schema.MAP_CELLS)
    map_record = metadata.get(schema.MAP_SOURCE, {})
    if map_out is not None and map_record.get("format") != "beesoft":
        raise MclError("no beesoft map travels in this file: there is none to give back", path=mcap)
    segments = from_metadata(metadata[schema.SEGMENTS])
    scans = decode_scans(messages[schema.SCAN])
    odometry = decode_odometry(messages[schema.ODOMETRY])
    lasers = decode_poses(messages[schema.LASER_POSE])
    lines = format_lines(_restore(scans, odometry, lasers, segments))
    if lines_kept is not None:
        kept = {int(sequence): text for sequence, text in json.loads(gzip.decompress(lines_kept)).items()}
        lines = [kept.get(int(s), line) for s, line in zip(odometry.sequences, lines, strict=True)]
    source_of = np.array([segment.source for segment in segments])[_segment_of(odometry.sequences, segments)]
    written = []
    for source in np.unique(source_of).tolist():
        path = log_out if source == 0 else log_out.with_name(_numbered(log_out.name, source + 1))
        text = "".join(f"{line}\n" for line, own in zip(lines, source_of, strict=True) if own == source)
        write_text(path, text)
        written.append(path)
    if map_out is not None and cells is not None:
        if map_kept is not None:
            text = gzip.decompress(map_kept).decode("ascii")
        else:
            text = beesoft.format_beesoft(map_record["header"], unpack_grid(cells))
        write_text(map_out, text)
        written.append(map_out)
    return written


def _arrange(
    logs: Sequence[CmuLog], drop: Sequence[tuple[float, float]], sources: Sequence[Path]
) -> tuple[CmuLog, list[Segment], NDArray[np.int64]]:
    """All logs as one, stamps following each other, without what is to be dropped; the stretches it consists of; and
    when (ns) those begin before which a clock began anew, within a log."""
    parts = [(k, part) for k, log in enumerate(logs) for part in log.stretches()]
    shifts, offsets = [0], [0]
    for (k, before), (number, log) in pairwise(parts):
        gap = GAP if number == k else JOIN_GAP
        shifts.append(int(before.stamps[-1]) + shifts[-1] + gap - int(log.stamps[0]))
        offsets.append(offsets[-1] if number == k else int(before.lines[-1]) + offsets[-1])
    part_of = np.repeat(np.arange(len(parts)), [len(log) for _, log in parts])
    joined = CmuLog(
        np.concatenate([log.lines + offset for (_, log), offset in zip(parts, offsets, strict=True)]),
        np.concatenate([log.is_scan for _, log in parts]),
        np.concatenate([log.stamps + shift for (_, log), shift in zip(parts, shifts, strict=True)]),
        np.concatenate([log.poses for _, log in parts]),
        np.concatenate([log.laser_poses for _, log in parts]),
        np.concatenate([log.ranges for _, log in parts]),
    )
    if int(joined.stamps[-1]) > MAX_STAMP:
        raise MclError("the joined logs last too long for ROS 2 stamps", path=sources[-1])
    keep = np.ones(len(joined), dtype=np.bool_)
    for begin, end in drop:
        if not (math.isfinite(begin) and math.isfinite(end) and 0 <= begin <= end):
            raise MclError(f"an interval to drop must be 0 <= begin <= end in seconds, not {begin}..{end}")
        since = joined.stamps - joined.stamps[0]
        keep &= (since < round(begin * 1e9)) | (since > round(end * 1e9))
    if not (keep & joined.is_scan).any():
        raise MclError("nothing is left: every scan lies in what is to be dropped", path=sources[0])
    kept = np.flatnonzero(keep)
    log, part_of = joined.take(keep), part_of[keep]
    starts = [0, *(np.flatnonzero((np.diff(kept) > 1) | (np.diff(part_of) > 0)) + 1).tolist()]
    motions = continue_odometry(_metres(log.poses), starts)
    segments = []
    for start, motion in zip(starts, motions, strict=True):
        k = int(part_of[start])
        segments.append(Segment(parts[k][0], int(log.lines[start]), offsets[k], shifts[k], motion))
    anew = [k for k in range(1, len(parts)) if parts[k][0] == parts[k - 1][0]]
    begins = [int(log.stamps[0]), *(int(parts[k][1].stamps[0]) + shifts[k] for k in anew)]
    return log, segments, np.array(begins, np.int64)


def _columns(log: CmuLog, segments: Sequence[Segment]) -> tuple[ScanColumns, PoseColumns, PoseColumns]:
    """What is written as /scan, /odom and /laser_pose."""
    which = _segment_of(log.lines, segments)
    poses, lasers = _metres(log.poses), _metres(log.laser_poses)
    for k, segment in enumerate(segments):
        poses[which == k] = move(poses[which == k], segment.motion)
        here = which[log.is_scan] == k
        lasers[here] = move(lasers[here], segment.motion)
    stamps, sequences = log.stamps[log.is_scan], log.lines[log.is_scan]
    scans = ScanColumns(
        stamps,
        sequences,
        (log.ranges / 100.0).astype(np.float32),
        angle_min=math.radians(-90.0),
        angle_increment=math.radians(180.0 / BEAMS),
        range_min=0.0,
        range_max=MAX_RANGE_CM / 100.0,
        frame=schema.LASER_FRAME,
    )
    odometry = planar_poses(log.stamps, log.lines, poses, schema.ODOM_FRAME, schema.BASE_FRAME)
    return scans, odometry, planar_poses(stamps, sequences, lasers, schema.ODOM_FRAME)


def _restore(scans: ScanColumns, odometry: PoseColumns, lasers: PoseColumns, segments: Sequence[Segment]) -> CmuLog:
    """The raw log from the messages, in the source's units, stamps and odometry frame; ``lines`` stay sequences."""
    which = _segment_of(odometry.sequences, segments)
    is_scan = np.isin(odometry.sequences, scans.sequences)
    shifts = np.array([segment.stamp_shift for segment in segments])
    poses, laser_poses = _with_turns(odometry), _with_turns(lasers)
    for k, segment in enumerate(segments):
        poses[which == k] = move_back(poses[which == k], segment.motion)
        here = which[is_scan] == k
        laser_poses[here] = move_back(laser_poses[here], segment.motion)
    return CmuLog(
        odometry.sequences,
        is_scan,
        odometry.stamps - shifts[which],
        _centimetres(poses),
        _centimetres(laser_poses),
        np.round(scans.ranges.astype(np.float64) * 100.0, 2),
    )


def _unfaithful_lines(restored: CmuLog, segments: Sequence[Segment], texts: Sequence[bytes]) -> dict[str, str]:
    """Lines of the source, by sequence, whose numbers the messages would not give back."""
    sources = [text.split(b"\n") for text in texts]
    result = {}
    which = _segment_of(restored.lines, segments).tolist()
    for sequence, k, line in zip(restored.lines.tolist(), which, format_lines(restored), strict=True):
        segment = segments[k]
        tokens = sources[segment.source][sequence - segment.sequence_offset - 1].decode("ascii").split()
        again = line.split()
        if tokens != again and list(map(float, tokens[1:])) != list(map(float, again[1:])):
            result[str(sequence)] = " ".join(tokens)
    return result


def _laser_pose(log: CmuLog) -> tuple[Pose, bool]:
    """The laser in base_link, to the millimetre, from the L lines; False and the usual place if they do not say it."""
    robot, laser = _metres(log.poses[log.is_scan]), _metres(log.laser_poses)
    if not laser.any() and robot.any():
        return DEFAULT_LASER_POSE, False
    dx, dy = (laser - robot)[:, :2].T
    cos, sin = np.cos(robot[:, 2]), np.sin(robot[:, 2])
    offsets = [cos * dx + sin * dy, cos * dy - sin * dx, wrap_angle(laser[:, 2] - robot[:, 2])]
    x, y, yaw = (round(float(np.median(offset)), 3) + 0.0 for offset in offsets)  # + 0.0: no negative zero
    return (x, y, yaw), True


def _read_map(path: Path | None) -> tuple[OccupancyGrid | None, dict[str, str], dict[str, bytes]]:
    """The grid, what the metadata says of it, and the file itself if the grid cannot give its numbers back."""
    if path is None:
        return None, {}, {}
    data = map_bytes(path)
    record = {"file": Path(path).name, "sha256": sha256(path)}
    if not beesoft.is_beesoft(data[:HEAD]):
        return read_map(path), record | {"format": "map_server"}, {}
    raw = beesoft.parse_beesoft(data, path)
    grid = raw.grid
    faithful = np.array_equal(beesoft.file_values(grid), raw.values)
    attachments = {} if faithful else {VERBATIM_MAP: gzip.compress(data, mtime=0)}
    return grid, record | {"format": "beesoft", "header": raw.header}, attachments


def _segment_of(sequences: NDArray[np.int64], segments: Sequence[Segment]) -> NDArray[np.int64]:
    return np.searchsorted([s.first_sequence for s in segments], sequences, side="right") - 1


def _metres(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    return poses / np.array([100.0, 100.0, 1.0])


def _centimetres(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.round(poses * np.array([100.0, 100.0, 1.0]), 6)


def _with_turns(poses: PoseColumns) -> NDArray[np.float64]:
    """Poses in the plane with yaw in (-2 pi, 2 pi], as ``planar_poses`` was given it."""
    _, _, z, w = poses.orientations.T
    return np.column_stack([poses.positions[:, :2], 2.0 * np.arctan2(z, w)])


def _numbered(name: str, number: int) -> str:
    stem, dot, rest = name.partition(".")
    return f"{stem}-{number}{dot}{rest}"
