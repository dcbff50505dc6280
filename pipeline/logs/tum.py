"""Trajectories as the TUM benchmark writes them: ``stamp x y z qx qy qz qw`` a line, ``#`` begins a comment."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from pipeline.errors import MclError
from pipeline.geometry import quaternion_to_yaw, yaw_to_quaternion
from pipeline.logs.messages import Trajectory
from pipeline.logs.stamps import format_stamp, parse_stamp

_FARTHEST, _LATEST = 1e100, 2**63 - 1
LINES = "TUM lines: stamp x y z qx qy qz qw"


def read_tum(path: Path | str, frame: str = "map") -> Trajectory:
    """The planar poses of a TUM file, in the order of the file; z, roll and pitch are ignored.

    Stamps are exact to the nanosecond. Raises MclError naming file and line for anything but eight
    finite numbers, a quaternion of length zero, or stamps that do not increase.
    """
    path = Path(path)
    stamps: list[int] = []
    rows: list[list[float]] = []
    for number, line in enumerate(read_lines(path, f"give a trajectory as {LINES}"), start=1):
        text = line.partition("#")[0].split()
        if not text:
            continue
        if len(text) != 8:
            raise MclError(f"expected 8 numbers (stamp x y z qx qy qz qw), found {len(text)}", path=path, line=number)
        try:
            stamp, row = parse_stamp(text[0]), [float(value) for value in text[1:]]
        except ValueError as error:
            raise MclError(f"not a number: {error}", path=path, line=number) from error
        if not all(map(math.isfinite, row)):
            raise MclError("NaN or an infinite number in a pose", path=path, line=number)
        if max(map(abs, row)) > _FARTHEST or abs(stamp) > _LATEST:
            raise MclError("a number that no pose has", path=path, line=number)
        if not sum(part * part for part in row[3:]):
            raise MclError("the quaternion has length zero", path=path, line=number)
        if stamps and stamp <= stamps[-1]:
            raise MclError("the stamps do not increase", path=path, line=number)
        stamps.append(stamp)
        rows.append(row)
    if not rows:
        raise MclError("no poses in this file", f"expected {LINES}", path=path)
    x, y, _, qx, qy, qz, qw = np.array(rows, dtype=np.float64).T
    norm = np.sqrt(qx**2 + qy**2 + qz**2 + qw**2)
    yaw = quaternion_to_yaw(qx / norm, qy / norm, qz / norm, qw / norm)
    return Trajectory(np.array(stamps, dtype=np.int64), np.stack([x, y, yaw], axis=1), frame)


def write_tum(path: Path | str, trajectory: Trajectory) -> None:
    """Writes one line per pose, nine decimals each, stamps exact to the nanosecond."""
    lines = []
    for stamp, (x, y, yaw) in zip(trajectory.stamps.tolist(), trajectory.poses.tolist(), strict=True):
        _, _, qz, qw = yaw_to_quaternion(yaw)
        zero = "0.000000000"
        lines.append(f"{format_stamp(stamp)} {x:.9f} {y:.9f} {zero} {zero} {zero} {qz:.9f} {qw:.9f}\n")
    Path(path).write_text("".join(lines), encoding="ascii")


def read_lines(path: Path, hint: str) -> list[str]:
    """The lines of a text file; ``hint`` says what was expected. Raises MclError if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError as error:
        raise MclError("no such file", path=path) from error
    except UnicodeDecodeError as error:
        raise MclError("not a text file", hint, path=path) from error
    except OSError as error:
        raise MclError(f"cannot be read: {error.strerror}", hint, path=path) from error
