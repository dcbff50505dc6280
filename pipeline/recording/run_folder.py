"""The folder of a run: everything that it wrote, and nothing that another run wrote."""

from __future__ import annotations

import json
import os
import re
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.config import Config, dump_config
from pipeline.errors import MclError
from pipeline.logs.messages import Trajectory
from pipeline.logs.tum import write_tum
from pipeline.world.seen import MEMORY

RECORDINGS = Path("recordings")
CLAIMED = ".claimed.part"
"""In a folder that somebody named, until the configuration is there: of two runs that begin at once one has it."""
RECORDING, TRAJECTORY, CONFIG, RUN = "run.rrd", "trajectory.tum", "config.yaml", "run.json"


@dataclass(frozen=True)
class RunFolder:
    """An own, fresh folder; nothing in it is ever overwritten."""

    path: Path

    @property
    def recording(self) -> Path:
        """The .rrd, written by RerunSink while the run goes on."""
        return self.path / RECORDING

    @property
    def trajectory(self) -> Path:
        """The estimate at every scan, TUM format."""
        return self.path / TRAJECTORY

    @property
    def config(self) -> Path:
        """The effective configuration, YAML."""
        return self.path / CONFIG

    @property
    def run(self) -> Path:
        """What ran and what came out, JSON."""
        return self.path / RUN

    @property
    def memory(self) -> Path:
        """What the scans have shown of the world, for later runs and for a renewed map."""
        return self.path / MEMORY

    def write_config(self, config: Config, heading: Sequence[str] = ()) -> None:
        """Saves the effective configuration, below lines of comment; ``load_config`` reads it back."""
        comment = "".join(f"# {_printable(line)}".rstrip() + "\n" for line in heading)
        _write_new(self.config, comment + dump_config(config))
        (self.path / CLAIMED).unlink(missing_ok=True)

    def write_trajectory(self, trajectory: Trajectory) -> None:
        """Saves the estimate at every scan."""
        _refuse_existing(self.trajectory)
        write_tum(self.trajectory, trajectory)

    def write_run(self, values: Mapping[str, Any]) -> None:
        """Saves JSON-like values; the file appears when it is complete. NaN and infinities become null."""
        _write_new(self.run, json.dumps(_plain(values), indent=2, allow_nan=False) + "\n")


def newest(root: Path | str = RECORDINGS) -> Path:
    """The folder of the run whose recording was written last: below ``root``, or in the folder that one works in.

    Raises MclError where there is none.
    """
    recordings = [*Path(root).glob(f"*/*/{RECORDING}"), *Path().glob(f"*/{RECORDING}")]
    if not recordings:
        raise MclError(
            f"there is no run yet in {root}/ or in this folder",
            "mcl localize and mcl demo make one; or name its folder",
        )
    return max(recordings, key=lambda path: (path.stat().st_mtime_ns, str(path))).parent


def create(log_name: str, output: Path | str | None = None, *, root: Path | str = RECORDINGS) -> RunFolder:
    """A fresh folder ``root/<log>/<date-time>``, numbered where runs start in the same second; or ``output`` itself.

    Raises MclError where ``output`` exists and is not an empty folder, or nothing can be written.
    """
    try:
        if output is not None:
            return RunFolder(_claim(Path(output)))
        name = re.sub(r"[^\w.+-]+", "_", log_name).strip(".") or "log"
        parent = Path(root) / name
        parent.mkdir(parents=True, exist_ok=True)
        stem = time.strftime("%Y-%m-%d_%H-%M-%S")
        number = 1
        while True:
            path = parent / (stem if number == 1 else f"{stem}_{number}")
            try:
                path.mkdir()  # fails if another run was quicker: two never share a folder
                return RunFolder(path)
            except FileExistsError:
                number += 1
    except OSError as error:
        raise MclError(f"cannot create the run's folder: {error.strerror}", path=error.filename) from error


def _claim(path: Path) -> Path:
    if path.exists() and not (path.is_dir() and not any(path.iterdir())):
        raise MclError("the output exists and is not an empty folder", "runs are never overwritten", path=path)
    if path.exists():
        try:
            (path / CLAIMED).touch(exist_ok=False)
        except FileExistsError as error:
            raise MclError("another run has just begun in this folder", "name another one", path=path) from error
        return path
    fresh = path.with_name(f".{path.name}.{os.getpid()}.part")
    fresh.mkdir(parents=True)
    try:
        (fresh / CLAIMED).touch()
        fresh.rename(path)  # fails if another run was quicker: its folder is not empty
    except OSError as error:
        if path.exists():
            raise MclError("another run has just begun in this folder", "name another one", path=path) from error
        raise
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
    return path


def _refuse_existing(path: Path) -> None:
    if path.exists():
        raise MclError("this file exists already", "runs are never overwritten", path=path)


def _write_new(path: Path, text: str) -> None:
    _refuse_existing(path)
    partial = path.with_name(f".{path.name}.part")
    with partial.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    partial.rename(path)


def _printable(line: str) -> str:
    """What a name of a file may hold and a line of YAML may not becomes a question mark."""
    return "".join(character if character.isprintable() else "?" for character in line)


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):  # numpy scalars and arrays
        return _plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and (value != value or value in (float("inf"), float("-inf"))):
        return None
    if value is None or isinstance(value, str | int | float):
        return value
    return str(value)
