"""What the messages of one topic say, in columns: the step between raw messages and a Log."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.geometry import quaternion_to_yaw


@dataclass(frozen=True)
class ScanColumns:
    """n scans of one laser, as recorded: ``stamps`` (n,) int64 ns, ``sequences`` (n,) int64, ``ranges`` (n, beams) m.

    Angles in radians in the laser's own frame ``frame``; nothing is cleaned or turned round yet. ``resampled``: how
    many of the scans had other beams and were brought onto these. ``time_increment``: seconds from beam to beam in the
    order of the message. ``stretch`` (n,): how often the stamps had begun anew before, None if they never do;
    ``remarks``: what a user should know of how they were read.
    """

    stamps: NDArray[np.int64]
    sequences: NDArray[np.int64]
    ranges: NDArray[np.float32]
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    frame: str
    resampled: int = 0
    time_increment: float = 0.0
    stretch: NDArray[np.int64] | None = None
    remarks: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.stamps)

    def take(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> ScanColumns:
        """The scans of these rows."""
        stretch = None if self.stretch is None else self.stretch[rows]
        return replace(
            self,
            stamps=self.stamps[rows],
            sequences=self.sequences[rows],
            ranges=self.ranges[rows],
            stretch=stretch,
        )


@dataclass(frozen=True)
class PoseColumns:
    """n poses of ``child_frame`` in ``frame``: ``stamps`` (n,) int64 ns, ``sequences`` (n,) int64.

    ``positions`` (n, 3) metres; ``orientations`` (n, 4) quaternions x, y, z, w; ``stretch``, ``remarks`` as for scans.
    """

    stamps: NDArray[np.int64]
    sequences: NDArray[np.int64]
    positions: NDArray[np.float64]
    orientations: NDArray[np.float64]
    frame: str
    child_frame: str = ""
    stretch: NDArray[np.int64] | None = None
    remarks: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.stamps)

    def take(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> PoseColumns:
        """The poses of these rows."""
        stretch = None if self.stretch is None else self.stretch[rows]
        return replace(
            self,
            stamps=self.stamps[rows],
            sequences=self.sequences[rows],
            positions=self.positions[rows],
            orientations=self.orientations[rows],
            stretch=stretch,
        )

    @property
    def planar(self) -> NDArray[np.float64]:
        """The poses in the plane, (n, 3): m, m, rad."""
        return np.column_stack([self.positions[:, :2], quaternion_to_yaw(*self.orientations.T)])


def planar_poses(
    stamps: NDArray[np.int64],
    sequences: NDArray[np.int64],
    poses: NDArray[np.float64],
    frame: str,
    child_frame: str = "",
) -> PoseColumns:
    """Poses (n, 3) in the plane as columns; a yaw in (-2 pi, 2 pi] keeps its turn, since q and -q differ."""
    zero = np.zeros(len(poses))
    x, y, half = poses[:, 0], poses[:, 1], poses[:, 2] / 2
    return PoseColumns(
        stamps,
        sequences,
        np.column_stack([x, y, zero]),
        np.column_stack([zero, zero, np.sin(half), np.cos(half)]),
        frame,
        child_frame,
    )


@dataclass(frozen=True)
class GyroscopeColumns:
    """n readings of a gyroscope: ``stamps`` (n,) int64 ns, ``rates`` (n,) float64 rad/s about the robot's z axis.

    ``stretch`` as for scans.
    """

    stamps: NDArray[np.int64]
    rates: NDArray[np.float64]
    frame: str = "base_link"
    stretch: NDArray[np.int64] | None = None

    def take(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> GyroscopeColumns:
        """The readings of these rows."""
        stretch = None if self.stretch is None else self.stretch[rows]
        return replace(self, stamps=self.stamps[rows], rates=self.rates[rows], stretch=stretch)
