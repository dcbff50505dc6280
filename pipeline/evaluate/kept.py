"""Runs that were finished before: an evaluation that was stopped goes on where it was.

A run is kept under a checksum of all that decides it: what the filter is given (the scans with their faults, the map
with its changes, the configuration, the seed) and the source that runs it. What is kept is what the filter said; it is
scored anew every time.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import pipeline
from pipeline.config import Config
from pipeline.evaluate.calibration import stated_probability
from pipeline.evaluate.metrics import Array
from pipeline.evaluate.report import versions
from pipeline.filter.step import TAKEOVERS
from pipeline.logs.messages import Log
from pipeline.outputs import replacing

if TYPE_CHECKING:
    from pipeline.localization import RunResult


@dataclass(frozen=True)
class Outcome:
    """What is scored of a run: ``poses`` (n, 3), ``weights`` (n,), ``explained`` (n,), ``covariances`` (n, 3, 3) and
    ``hindsight`` (n, 3) as in RunResult; ``probability`` (n,) that each pose is right, as stated; ``lost_at`` (k,):
    scans at which the filter said that it was lost; ``seconds``, ``elapsed``: of wall clock, by part and in all.
    """

    poses: Array
    weights: Array
    probability: Array
    explained: Array
    covariances: Array
    hindsight: Array | None
    lost_at: NDArray[np.int64]
    seconds: Mapping[str, float]
    elapsed: float

    @classmethod
    def of(cls, result: RunResult, elapsed: float) -> Outcome:
        """Of a run that took so many seconds."""
        lost = [index for index, _, event in result.events if event.kind in TAKEOVERS]
        return cls(
            result.poses, result.weights, stated_probability(result), result.explained, result.covariances,
            result.hindsight, np.array(lost, np.int64), dict(result.seconds), elapsed,
        )  # fmt: skip


@dataclass(frozen=True)
class Kept:
    """The runs in ``folder`` that this ``source`` made."""

    folder: Path
    source: str

    def key(self, log: Log, config: Config, seed: int, runner: Callable[..., Any]) -> str:
        """A checksum of all that decides the run."""
        digest = hashlib.sha256()
        grid = None if log.grid is None else log.grid.sha256
        said = (config.model_dump_json(), seed, runner.__module__, runner.__qualname__, self.source, grid, log.wheels)
        digest.update(repr((*said, log.laser)).encode())
        for column in (log.stamps, log.odometry, log.ranges, log.sweeps, log.turns, log.stretches):
            digest.update(b"-" if column is None else f"{column.dtype}{column.shape}".encode() + column.tobytes())
        return digest.hexdigest()[:32]

    def read(self, key: str) -> Outcome | None:
        """The run of this key; None if it is not there, or damaged."""
        try:
            with np.load(self._file(key)) as file:
                arrays = {name: file[name] for name in file.files}
            told = json.loads(str(arrays.pop("told")))
            return Outcome(hindsight=arrays.pop("hindsight", None), **arrays, **told)
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile):
            return None

    def write(self, key: str, outcome: Outcome) -> None:
        """Keep a run; raises MclError where that is not possible."""
        arrays: dict[str, Any] = {name: value for name, value in vars(outcome).items() if isinstance(value, np.ndarray)}
        told = json.dumps({"seconds": dict(outcome.seconds), "elapsed": outcome.elapsed})
        with replacing(self._file(key)) as partial:
            np.savez(partial, told=np.array(told), **arrays)

    def _file(self, key: str) -> Path:
        return self.folder / f"{key}.npz"


@cache
def source_checksum() -> str:
    """A checksum of all source of this package, and of the versions that decide a result."""
    digest = hashlib.sha256(json.dumps(versions()).encode())
    root = Path(pipeline.__file__).parent
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()
