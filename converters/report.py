"""What a conversion did, for people and programs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class ConversionReport:
    """Counts are of the source's ``unit``; ``duration`` in seconds from first to last; ``size`` in bytes."""

    format: str
    lines: int
    scans: int
    odometry: int
    dropped: int
    duration: float
    output: Path
    size: int
    unit: str = "lines"
