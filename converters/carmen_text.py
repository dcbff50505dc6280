"""CARMEN's text logs: FLASER, RLASER, ROBOTLASER1 and TRUEPOS lines, metres and radians.

``FLASER n r1 ... rn x y theta x y theta ipc host logger``: the ranges, the laser's pose and the robot's, both in the
odometry frame, and the stamp that counts, that of the sender (ipc). Lines of unknown types are skipped and counted.
"""

from __future__ import annotations

import bz2
import math
import re
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from converters.text import read_bytes
from pipeline.errors import MclError
from pipeline.logs.stamps import format_stamp, parse_stamp

BZIP2_MAGIC = b"BZh"
MAX_STAMP = (2**31 - 1) * 1_000_000_000  # seconds are a signed 32-bit number in ROS 2
MIN_STEP = 100_000  # ns between stamps that had to be repaired
LASERS = ("ROBOTLASER1", "FLASER", "RLASER")
"""Line types of scans, the ones to be preferred first: ROBOTLASER1 says its own angles, RLASER looks back."""

_LINE = re.compile(
    rb"^(?:[FR]LASER \d+ |ROBOTLASER1 \d+ |ODOM [-\d.]+ |PARAM \w+ |TRUEPOS [-\d.]+ |# CARMEN)", re.MULTILINE
)
_LENGTHS = {b"ODOM": 10, b"TRUEPOS": 10}
_ROBOTLASER_HEAD, _ROBOTLASER_TAIL = 9, 14  # tokens before the ranges; after the remissions
_FLASER_HEAD, _FLASER_TAIL = 2, 9
_FIELDS = {
    **{n: (-math.pi / 2, math.radians(1.0)) for n in (180, 181)},
    **{n: (-math.pi / 2, math.radians(0.5)) for n in (360, 361)},
    **{n: (math.radians(-50.0), math.radians(0.25)) for n in (400, 401)},
}
"""First angle and step by the count of an FLASER line, which says no more: those of a SICK laser, as CARMEN guesses.

Any other count reaches from -90 to 90 degrees. With 400 and 401 CARMEN begins at -90 as well, but that mode of
the laser looks 50 degrees to either side.
"""


@dataclass(frozen=True)
class Beams:
    """Directions of a scan's beams in the laser's frame, radians; ``max_range``: metres, None if no line says."""

    count: int
    angle_min: float
    angle_increment: float
    max_range: float | None = None


@dataclass(frozen=True)
class CarmenLog:
    """The m scans of one laser, in the order of the file: ``lines`` (m,) 1-based, ``stamps`` (m,) int64 ns, increasing.

    ``laser_poses``, ``robot_poses`` (m, 3) m, m, rad in the odometry frame; ``ranges`` (m, beams) metres as written.
    ``truth_stamps`` (k,), ``truth_poses`` (k, 3): the robot in a simulator's world. ``params``: the PARAM lines.
    ``counts``: lines by type. ``repaired``: scans whose stamp had to change because time ran backwards.
    """

    kind: str
    beams: Beams
    lines: NDArray[np.int64]
    stamps: NDArray[np.int64]
    laser_poses: NDArray[np.float64]
    robot_poses: NDArray[np.float64]
    ranges: NDArray[np.float64]
    truth_stamps: NDArray[np.int64]
    truth_poses: NDArray[np.float64]
    params: dict[str, str]
    counts: dict[str, int]
    repaired: int

    def __len__(self) -> int:
        return len(self.stamps)

    def take(self, keep: NDArray[np.bool_]) -> CarmenLog:
        """The scans where ``keep`` (m,) is true."""
        columns = ("lines", "stamps", "laser_poses", "robot_poses", "ranges")
        return replace(self, **{name: getattr(self, name)[keep] for name in columns})


@dataclass(frozen=True)
class _Row:
    line: int
    stamp: int
    poses: list[float]
    ranges: list[float]


def is_carmen_text(path: Path, head: bytes) -> bool:
    """Whether a file whose first bytes are ``head`` looks like a CARMEN log, packed with bzip2 or not."""
    if head.startswith(BZIP2_MAGIC):
        try:
            with bz2.open(path) as file:
                head = file.read(1 << 16)
        except (OSError, EOFError):
            return False
    return _LINE.search(head) is not None


def read_carmen(path: Path) -> CarmenLog:
    """Reads a log, plain, gzipped or packed with bzip2; stamps exact to the nanosecond.

    Raises MclError with file and line for a known line type with a wrong count of numbers (a cut line), what is not a
    finite number, a stamp out of bounds, scans of several sizes, and for a file without scans.
    """
    data = read_bytes(path)
    if data.startswith(BZIP2_MAGIC):
        try:
            data = bz2.decompress(data)
        except (OSError, ValueError, EOFError) as error:
            raise MclError("this bzip2 file is cut or damaged", path=path) from error
    return parse_carmen(data, path)


def parse_carmen(data: bytes, path: Path) -> CarmenLog:
    """The same from bytes that are already unpacked; ``path`` names them in errors."""
    counts: Counter[str] = Counter()
    params: dict[str, str] = {}
    truth: list[_Row] = []
    scans: dict[str, list[_Row]] = {kind: [] for kind in LASERS}
    beams: dict[str, Beams] = {}
    for number, line in enumerate(data.split(b"\n"), start=1):
        tokens = line.split()
        if not tokens or tokens[0].startswith(b"#"):
            continue
        kind = tokens[0].decode("ascii", errors="replace")
        counts[kind] += 1
        try:
            if kind in scans:
                row, shape = _scan(kind, tokens, number)
                if beams.setdefault(kind, shape) != shape:
                    raise ValueError(_differs(shape, beams[kind]))
                scans[kind].append(row)
            elif kind == "PARAM":
                params[_text(tokens, 1)] = _text(tokens, 2)
            elif tokens[0] in _LENGTHS:
                _expect(tokens, _LENGTHS[tokens[0]])
                row = _Row(number, _stamp(tokens[-3]), _finite(tokens[1:7]), [])
                if kind == "TRUEPOS":
                    truth.append(row)
        except ValueError as error:
            raise MclError(f"{kind}: {error}", path=path, line=number) from None
    kind = next((k for k in LASERS if scans[k]), "")
    if not kind:
        found = ", ".join(f"{count} {name}" for name, count in counts.most_common(5)) or "nothing"
        raise MclError(f"no laser scans ({', '.join(LASERS)}) in this log, but {found}", path=path)
    rows = scans[kind]
    poses = np.array([row.poses for row in rows], dtype=np.float64)
    raw = _column([row.stamp for row in rows])
    stamps = in_order(raw)
    truth_stamps = in_order(_column([row.stamp for row in truth]))
    return CarmenLog(
        kind=kind,
        beams=beams[kind],
        lines=_column([row.line for row in rows]),
        stamps=stamps,
        laser_poses=poses[:, :3],
        robot_poses=poses[:, 3:],
        ranges=np.array([row.ranges for row in rows], dtype=np.float64),
        truth_stamps=truth_stamps,
        truth_poses=np.array([row.poses[:3] for row in truth], dtype=np.float64).reshape(-1, 3),
        params=params,
        counts=dict(counts),
        repaired=int((stamps != raw).sum()),
    )


def in_order(stamps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Increasing stamps (n,) in ns for lines in the order of the file, as near to the given ones as can be.

    The order of the lines is the truth where the stamps run backwards: sorted by stamp, a robot's path jumps to and
    fro. So the stamps give way: isotonic regression (the increasing sequence with the least sum of squared changes),
    whose ties are then spread by 0.1 ms. Stamps that increase already come back as they are.
    """
    if len(stamps) < 2 or (np.diff(stamps) > 0).all():
        return stamps
    from scipy.optimize import isotonic_regression

    result = np.rint(isotonic_regression((stamps - stamps[0]).astype(np.float64)).x).astype(np.int64)
    for i in range(1, len(result)):
        result[i] = max(result[i], result[i - 1] + MIN_STEP)
    return result + stamps[0]


def _scan(kind: str, tokens: list[bytes], number: int) -> tuple[_Row, Beams]:
    if kind == "ROBOTLASER1":
        return _robotlaser(tokens, number)
    n = _count(tokens, 1)
    _expect(tokens, _FLASER_HEAD + n + _FLASER_TAIL)
    beams = Beams(n, *_FIELDS.get(n, (-math.pi / 2, math.pi / (n - 1))))
    ranges, rest = tokens[_FLASER_HEAD : _FLASER_HEAD + n], tokens[_FLASER_HEAD + n :]
    return _Row(number, _stamp(rest[6]), _finite(rest[:6]), _finite(ranges)), beams


def _robotlaser(tokens: list[bytes], number: int) -> tuple[_Row, Beams]:
    n = _count(tokens, _ROBOTLASER_HEAD - 1)
    end = _ROBOTLASER_HEAD + n
    remissions = _count(tokens, end, least=0)
    _expect(tokens, end + 1 + remissions + _ROBOTLASER_TAIL)
    angle_min, _, increment, max_range = _finite(tokens[2:6])
    rest = tokens[end + 1 + remissions :]
    row = _Row(number, _stamp(rest[-3]), _finite(rest[:6]), _finite(tokens[_ROBOTLASER_HEAD:end]))
    return row, Beams(n, angle_min, increment, max_range)


def _differs(beams: Beams, before: Beams) -> str:
    if beams.count != before.count:
        return f"{beams.count} readings where the lines before have {before.count}"
    return "angles or longest range other than in the lines before"


def _count(tokens: list[bytes], at: int, least: int = 2) -> int:
    text = _text(tokens, at)
    if not text.isdecimal() or int(text) < least:
        raise ValueError(f"{text[:40]!r} is no number of readings")
    return int(text)


def _expect(tokens: list[bytes], words: int) -> None:
    if len(tokens) != words:
        raise ValueError(f"expected {words} words, found {len(tokens)}")


def _text(tokens: list[bytes], at: int) -> str:
    if at >= len(tokens):
        raise ValueError("the line is cut")
    return tokens[at].decode("ascii", errors="replace")


def _finite(tokens: list[bytes]) -> list[float]:
    try:
        values = list(map(float, tokens))
    except ValueError:
        values = [math.nan]
    if not math.isfinite(sum(values)):
        bad = next((t for t in tokens if not _is_finite(t)), b"")
        raise ValueError(f"{bad[:40].decode('ascii', errors='replace')!r} is not a finite number")
    return values


def _is_finite(token: bytes) -> bool:
    try:
        return math.isfinite(float(token))
    except ValueError:
        return False


def _stamp(token: bytes) -> int:
    stamp = parse_stamp(token.decode("ascii", errors="replace"))
    if not 0 <= stamp <= MAX_STAMP:
        raise ValueError(f"the stamp {format_stamp(stamp)} is out of bounds")
    return stamp


def _column(values: list[int]) -> NDArray[np.int64]:
    return np.array(values, dtype=np.int64)
