"""What a log holds once it is read: scans, the odometry at their stamps, the laser, and the truth where known."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.data_frame import data_frame
from pipeline.errors import MclError
from pipeline.geometry import Pose
from pipeline.logs import schema
from pipeline.maps.occupancy_grid import OccupancyGrid

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Laser:
    """A planar range finder on the robot: beam k points at angle_min + k * angle_increment from the laser's x axis.

    ``pose``: the laser in base_link (m, m, rad). A laser mounted upside down is stored the right
    way up: the reader turns the order of its ranges round. Ranges in metres, angles in radians.
    ``time_increment``: seconds from beam k to beam k + 1, negative where the reader turned the order round; the stamp
    of a scan is that of the beam measured first. 0 where the log does not say: then all beams are of the stamp.
    """

    pose: Pose
    angle_min: float
    angle_increment: float
    beams: int
    range_min: float
    range_max: float
    time_increment: float = 0.0

    @property
    def angles(self) -> NDArray[np.float64]:
        """Direction of every beam in the laser frame, radians, (beams,)."""
        return self.angle_min + self.angle_increment * np.arange(self.beams, dtype=np.float64)

    def longest(self, limit: float | None) -> float:
        """The longest range that counts, m: the laser's own, or ``limit`` where that is less."""
        return self.range_max if limit is None else min(limit, self.range_max)


@dataclass(frozen=True)
class Scan:
    """One sweep of the laser, with the odometry at its stamp.

    ``stamp``: integer nanoseconds; ``time``: seconds since the log's first scan; ``odometry``: pose of
    base_link in the odom frame, zeros if the log has none; ``ranges``: (beams,) float32 metres, NaN = invalid, inf =
    no return. ``sweep``: how the odometry moved (m, m, rad, robot's frame) from the first beam to the last; ``turn``:
    heading by the gyroscope, rad, from any zero. Both None where the log does not know. ``stretch``: how often the log
    had begun anew before; between scans of two stretches nobody knows how the robot moved.
    """

    index: int
    stamp: int
    time: float
    odometry: NDArray[np.float64]
    ranges: NDArray[np.float32]
    sweep: NDArray[np.float64] | None = None
    turn: float | None = None
    stretch: int = 0

    def __repr__(self) -> str:
        return f"Scan({self.index} at {self.time:.2f} s: {len(self.ranges)} ranges)"


@dataclass(frozen=True)
class Trajectory:
    """Poses over time: stamps (n,) int64 nanoseconds, increasing; poses (n, 3) metres and radians, frame ``frame``."""

    stamps: NDArray[np.int64]
    poses: NDArray[np.float64]
    frame: str = "map"

    def __len__(self) -> int:
        return len(self.stamps)

    def __repr__(self) -> str:
        seconds = float(self.stamps[-1] - self.stamps[0]) / 1e9 if len(self) else 0.0
        return f"Trajectory({len(self):,} poses in {seconds:.1f} s, frame {self.frame!r})"

    def to_pandas(self) -> pd.DataFrame:
        """A row per pose: stamp (ns), x, y (m), yaw (rad). Raises MclError without pandas."""
        x, y, yaw = self.poses.T
        return data_frame({"stamp": self.stamps, "x": x, "y": y, "yaw": yaw})


@dataclass(frozen=True)
class Log:
    """A whole recording in columns: n scans of one laser, odometry at their stamps, and what else the file knew.

    ``stamps`` (n,) int64 ns, never decreasing; ``odometry`` (n, 3) float64, base_link in odom, zeros if the log has
    no ``wheels``, that is, no odometry; ``ranges`` (n, beams) float32 m, NaN = invalid, inf = no return (REP 117,
    made uniform by the reader). ``sweeps`` (n, 3): how the odometry moved (m, m, rad, robot's frame) while each scan
    was measured; ``turns`` (n,): heading by the gyroscope of an IMU, rad, from any zero. Both None where unknown.
    ``stretches`` (n,) int64: how often the recording had begun anew before each scan (a simulation was reset, a loop
    played again), None if it never did; the odometry stands still between two of them, which says nothing.
    ``converted``: the .mcap that a raw log or a bag became, None where ``path`` is one.
    """

    name: str
    path: Path
    sha256: str
    laser: Laser
    stamps: NDArray[np.int64]
    odometry: NDArray[np.float64]
    ranges: NDArray[np.float32]
    grid: OccupancyGrid | None = None
    ground_truth: Trajectory | None = None
    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    wheels: bool = True
    sweeps: NDArray[np.float64] | None = None
    turns: NDArray[np.float64] | None = None
    stretches: NDArray[np.int64] | None = None
    converted: Path | None = None

    def __len__(self) -> int:
        return len(self.stamps)

    def __repr__(self) -> str:
        seconds = self.duration if len(self) else 0.0
        grid = "no map" if self.grid is None else f"map of {self.grid.size}"
        wheels, truth = "" if self.wheels else ", no odometry", "" if self.ground_truth is None else ", truth known"
        scans = f"{len(self):,} scans in {seconds:.1f} s, {self.laser.beams} beams"
        return f"Log({self.name!r}: {scans}, {grid}{wheels}{truth})"

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a user should know of how it was read: what was left out, taken otherwise, or chosen, a sentence each.

        Of an .mcap that `mcl convert` made, what the converter said then is not said again.
        """
        records = (schema.READER,) if self.converted is None else (schema.SOURCE, schema.READER)
        return tuple(text for name in records for text in json.loads(self.metadata.get(name, {}).get("remarks", "[]")))

    @property
    def mcap(self) -> Path:
        """The .mcap with the log's messages."""
        return self.path if self.converted is None else self.converted

    @property
    def told(self) -> dict[str, str]:
        """What its converter and its reader tell of how it was read; where both do, the converter of the source."""
        return {**self.metadata.get(schema.READER, {}), **self.metadata.get(schema.SOURCE, {})}

    def check_copied(self) -> None:
        """Raises MclError if the stamps are not those of the messages in the file, so that it cannot be copied."""
        if self.converted is None and self.metadata.get(schema.READER, {}).get("restamped"):
            raise MclError(
                "its messages have other stamps", "mcl convert makes a log of it that has these", path=self.path
            )

    @property
    def times(self) -> NDArray[np.float64]:
        """Seconds since the first scan, (n,)."""
        return (self.stamps - self.stamps[0]) / 1e9

    @property
    def duration(self) -> float:
        """Seconds from the first scan to the last."""
        return float(self.stamps[-1] - self.stamps[0]) / 1e9

    def part(self, rows: slice | NDArray[np.int64]) -> Log:
        """The same log with these scans only, in their order; it has no truth of its own."""
        columns = ("stamps", "odometry", "ranges", "sweeps", "turns", "stretches")
        taken = {name: column[rows] for name in columns if (column := getattr(self, name)) is not None}
        return replace(self, **taken, ground_truth=None)

    def without_short(self, limit: float) -> Log:
        """The same log in which readings of at most ``limit`` metres are invalid."""
        if limit <= 0.0:
            return self
        return replace(self, ranges=np.where(self.ranges <= np.float32(limit), np.float32(np.nan), self.ranges))

    def scans(self) -> Iterator[Scan]:
        """The scans in the order of their stamps."""
        times = self.times
        for i in range(len(self)):
            sweep = None if self.sweeps is None else self.sweeps[i]
            turn = None if self.turns is None else float(self.turns[i])
            stretch = 0 if self.stretches is None else int(self.stretches[i])
            stamp, time = int(self.stamps[i]), float(times[i])
            yield Scan(i, stamp, time, self.odometry[i], self.ranges[i], sweep, turn, stretch)
