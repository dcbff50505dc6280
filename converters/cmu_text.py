"""The O/L text logs of the CMU course: one line per odometry reading (O) or laser scan (L), centimetres and radians.

``O x y theta ts`` and ``L x y theta xl yl thetal r1 ... r180 ts``: the pose of the robot in the odometry
frame, the pose of the laser in it, 180 ranges counter-clockwise from the right, seconds since the start.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from converters.text import begins_anew, in_order, measured, read_log_bytes, settle, write_text
from pipeline.errors import MclError
from pipeline.logs.sound import FARTHEST
from pipeline.logs.stamps import format_stamp, parse_stamp
from pipeline.logs.stretches import numbered

BEAMS = 180
NO_RETURN_CM = 8191.0
MAX_RANGE_CM = 8182.0  # 8183, 8187, 8189 and 8191 are the codes of readings without return
MAX_STAMP = (2**31 - 1) * 1_000_000_000  # seconds are a signed 32-bit number in ROS 2
FARTHEST_CM = 100 * FARTHEST
MAX_TURN = 1e4  # rad: who turned farther never turned
_COMMENTS = (b"#", b"%", b"//")
_COUNTS = {b"O": 4, b"L": 7 + BEAMS}
_LINE = re.compile(rb"^[ \t]*[OL][ \t]", re.MULTILINE)


@dataclass(frozen=True)
class CmuLog:
    """A text log in columns: n lines of which m are scans.

    ``lines`` (n,) 1-based line numbers in the file; ``is_scan`` (n,); ``stamps`` (n,) int64 ns;
    ``poses`` (n, 3) robot, ``laser_poses`` (m, 3) laser, both cm, cm, rad in the odometry frame, as
    written; ``ranges`` (m, 180) float64 cm as written, codes of readings without return included. ``restarts``: rows
    before which the clock began anew; between them stamps never decrease. ``remarks``: what was left out or changed.
    """

    lines: NDArray[np.int64]
    is_scan: NDArray[np.bool_]
    stamps: NDArray[np.int64]
    poses: NDArray[np.float64]
    laser_poses: NDArray[np.float64]
    ranges: NDArray[np.float64]
    restarts: tuple[int, ...] = ()
    remarks: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.stamps)

    def take(self, keep: NDArray[np.bool_]) -> CmuLog:
        """The lines where ``keep`` (n,) is true, without regard to restarts."""
        scans = keep[self.is_scan]
        return CmuLog(
            self.lines[keep],
            self.is_scan[keep],
            self.stamps[keep],
            self.poses[keep],
            self.laser_poses[scans],
            self.ranges[scans],
        )

    def stretches(self) -> list[CmuLog]:
        """The parts between restarts of the clock."""
        number = np.searchsorted(self.restarts, np.arange(len(self)), side="right")
        return [self.take(number == k) for k in range(len(self.restarts) + 1)]


def is_log_text(head: bytes) -> bool:
    """Whether the first bytes of a text file look like an O/L log."""
    return _LINE.search(head) is not None


def read_log_text(path: Path) -> CmuLog:
    """Reads a log, plain or gzipped; stamps exact to the nanosecond.

    Comments (#, %, //) are skipped. Lines of an unknown type or with a wrong count of numbers, with what is no number
    that a robot measures, and a last line that is cut are left out while they are few; else MclError names the first.
    Where stamps run backwards a little they give way to the order of the lines; by more the clock begins anew.
    """
    data, remarks = read_log_bytes(path)
    return parse_log_text(data, path, remarks)


def parse_log_text(data: bytes, path: Path, remarks: Sequence[str] = ()) -> CmuLog:
    """The same from bytes that are already unpacked; ``path`` names them in errors, ``remarks`` are what is known."""
    lines: list[int] = []
    is_scan: list[bool] = []
    stamps: list[int] = []
    odometry: list[list[float]] = []
    scans: list[list[float]] = []
    errors: list[MclError] = []
    number = 0
    for number, line in enumerate(data.split(b"\n"), start=1):
        tokens = line.split()
        if not tokens or tokens[0].startswith(_COMMENTS):
            continue
        try:
            kind = _checked_kind(tokens, line, path, number)
            values, stamp = _numbers(tokens, path, number)
        except MclError as error:
            errors.append(error)
            continue
        lines.append(number)
        is_scan.append(kind == b"L")
        stamps.append(stamp)
        odometry.append(values[:3])
        scans.append(values[3:])
    unfinished = number if not data.endswith(b"\n") else None
    if unfinished is not None and lines and lines[-1] == number and _stamp_is_cut(data):
        errors.append(MclError("the last line is cut in the middle of its stamp", path=path, line=number))
        for column in (lines, is_scan, stamps, odometry, scans):
            column.pop()
    said = [*remarks, *settle(errors, len(lines) + len(errors), unfinished)]
    if not any(is_scan):
        raise MclError("no laser scans (L lines) in this log", "; ".join(said), path=path)
    laser = np.array([values for values, scan in zip(scans, is_scan, strict=True) if scan], dtype=np.float64)
    log = CmuLog(
        np.array(lines, dtype=np.int64),
        np.array(is_scan, dtype=np.bool_),
        np.array(stamps, dtype=np.int64),
        np.array(odometry, dtype=np.float64),
        laser[:, :3],
        laser[:, 3:],
    )
    return _in_time(log, said)


def _in_time(log: CmuLog, remarks: list[str]) -> CmuLog:
    """The log with stamps that do not decrease but where the clock begins anew."""
    number = numbered(log.stamps)
    restarts: tuple[int, ...] = ()
    if number is not None:
        if (stray := number < 0).any():
            first = int(log.lines[stray][0])
            remarks.append(f"{int(stray.sum())} lines left out, their stamps are far from those around: line {first}")
            log, number = log.take(~stray), number[~stray]
        restarts = tuple((np.flatnonzero(np.diff(number)) + 1).tolist())
    if restarts:
        remarks.append(begins_anew([int(log.lines[row]) for row in restarts]))
    stamps = log.stamps.copy()
    for start, end in pairwise([0, *restarts, len(stamps)]):
        if (np.diff(stamps[start:end]) < 0).any():
            stamps[start:end] = in_order(stamps[start:end])
    if changed := int((stamps != log.stamps).sum()):
        remarks.append(f"{changed:,} stamps ran backwards: the nearest that increase, in the order of the file")
    return replace(log, stamps=stamps, restarts=restarts, remarks=tuple(remarks))


def write_log_text(path: Path, log: CmuLog) -> None:
    """Writes a log as the course's files are written (six decimals, whole ranges), gzipped if the name ends in .gz."""
    write_text(path, "".join(f"{line}\n" for line in format_lines(log)))


def format_lines(log: CmuLog) -> list[str]:
    """The text of every line, in order, without line ends."""
    result = []
    lasers, ranges = iter(log.laser_poses.tolist()), iter(log.ranges.tolist())
    columns = zip(log.is_scan.tolist(), log.stamps.tolist(), log.poses.tolist(), strict=True)
    for is_scan, stamp, pose in columns:
        laser, beams = (next(lasers), next(ranges)) if is_scan else (None, None)
        result.append(format_log_line(stamp, pose, laser, beams))
    return result


def format_log_line(
    stamp: int, pose: list[float], laser_pose: list[float] | None = None, ranges: list[float] | None = None
) -> str:
    """One line: O, or L if a laser pose and ranges are given. Nanoseconds; cm, cm, rad; cm."""
    numbers = "{:.6f} {:.6f} {:.6f}".format
    seconds = format_stamp(stamp, 6)
    if laser_pose is None or ranges is None:
        return f"O {numbers(*pose)} {seconds}"
    beams = " ".join([f"{r:.0f}" if r == int(r) else f"{r:.10g}" for r in ranges])
    return f"L {numbers(*pose)} {numbers(*laser_pose)} {beams} {seconds}"


def _checked_kind(tokens: list[bytes], line: bytes, path: Path, number: int) -> bytes:
    kind = tokens[0]
    if kind not in _COUNTS:
        raise MclError(f"unknown line type {_show(kind)}, expected O or L", _hint(line), path=path, line=number)
    if len(tokens) - 1 != _COUNTS[kind]:
        raise MclError(_wrong_count(kind, len(tokens) - 1), path=path, line=number)
    return kind


def _numbers(tokens: list[bytes], path: Path, line: int) -> tuple[list[float], int]:
    try:
        values = list(map(float, tokens[1:-1]))
        stamp = parse_stamp(tokens[-1].decode("ascii"))
    except ValueError:
        bad = next((t for t in tokens[1:] if not _is_number(t)), tokens[-1])
        raise MclError(f"{_show(bad)} is not a number", path=path, line=line) from None
    if not measured(values, FARTHEST_CM) or abs(values[2]) > MAX_TURN:
        finite = math.isfinite(sum(map(abs, values)))
        said = "a number that no robot measures" if finite else "NaN or an infinite number"
        raise MclError(said, path=path, line=line)
    if not 0 <= stamp <= MAX_STAMP:
        raise MclError(f"the stamp {_show(tokens[-1])} is out of bounds", path=path, line=line)
    return values, stamp


def _is_number(token: bytes) -> bool:
    try:
        return math.isfinite(float(token))
    except ValueError:
        return False


def _wrong_count(kind: bytes, found: int) -> str:
    if kind == b"O":
        return f"an O line has 4 numbers (x y theta ts), this one has {found}"
    return f"an L line has 187 numbers ({BEAMS} ranges), this one has {found} ({max(found - 7, 0)} ranges)"


def _stamp_is_cut(data: bytes) -> bool:
    """Whether the last line's stamp has fewer decimals than those of all others, which agree."""
    *others, last = [len(line.split()[-1].partition(b".")[2]) for line in data.split(b"\n") if line.strip()]
    return len(set(others)) == 1 and last < others[0]


def _hint(line: bytes) -> str:
    if line.startswith((b"robot_specifications", b"global_map")):
        return "this is a beesoft map, not a log"
    return ""


def _show(token: bytes) -> str:
    return repr(token[:40].decode("ascii", errors="replace"))
