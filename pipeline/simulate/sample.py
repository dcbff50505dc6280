"""The embedded sample as a log that can be localized at once."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import converters
from pipeline.logs.messages import Log
from pipeline.logs.reader import read_log
from pipeline.simulate import sample_dir


def sample_log() -> Log:
    """The log of `mcl demo`: 86 s in a made-up office, with the map, and with the truth at every scan."""
    sample = sample_dir()
    raw, truth = sample / "office.log.gz", sample / "office_truth.tum"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "office.mcap"
        converters.convert([raw], path, map_path=sample / "office.dat.gz", ground_truth=truth)
        return replace(read_log(path), path=raw)
