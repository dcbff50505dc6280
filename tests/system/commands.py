"""What the tests of the command line share."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

Command = Callable[..., subprocess.CompletedProcess[str]]

FEW = ("--particles", "3000", "--set", "record_particles=200", "--set", "recovery=none")
"""Options for a run that is quick; it need not find the robot."""


@dataclass(frozen=True)
class Journey:
    """Where the files of one way from a building to a run lie: raw files, the log, the run's folder.

    ``simulated``: what `mcl simulate` said on stdout; ``short``: the log's first 40 s, for what need not be long.
    """

    simulated: str
    raw: Path
    log: Path
    short: Path
    run: Path
