"""What a conversion did, for people and programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

LEFT_OUT = "left out on request"
"""What the metadata say of odometry that the source had and the output has not."""


@dataclass(frozen=True)
class ConversionReport:
    """Counts are of the source's ``unit``; ``duration`` in seconds from first to last; ``size`` in bytes.

    ``odometry``: messages of it that were written, 0 where there is none; ``faults``: made on purpose, as texts;
    ``remarks``: what a user should know of how the source was read.
    """

    format: str
    lines: int
    scans: int
    odometry: int
    dropped: int
    duration: float
    output: Path
    size: int
    unit: str = "lines"
    remarks: tuple[str, ...] = ()
    faults: Sequence[str] = ()
