"""A recorded run as it is exported, and the moments of it that are worth a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.data_frame import data_frame
from pipeline.errors import MclError
from pipeline.inspect import Inspection, inspect_file, open_recording
from pipeline.maps.picture import css, figure, map_svg
from pipeline.recording import palette
from pipeline.recording.rrd_file import RrdFile
from pipeline.recording.scenes import Scenes, read_scenes

if TYPE_CHECKING:
    import pandas as pd

TITLES = {"converged": "converged", "diverged": "spread out again", "lost": "lost", "found": "found"}
"""Kinds of events that get a picture, and what it is called."""
MOST = 12
"""Pictures on a sheet."""
MARGIN = 1.0
"""Metres around what the map knows."""


@dataclass(frozen=True)
class Moment:
    """A row of the run, in a word, and in a sentence."""

    row: int
    title: str
    sentence: str


@dataclass(frozen=True)
class Run:
    """What is known of a run: ``told`` exactly, ``scenes`` as drawn, both with the same rows; the ``file`` itself."""

    told: Inspection
    scenes: Scenes
    file: RrdFile

    def __repr__(self) -> str:
        told = self.told
        converged = "never converged" if told.converged_at is None else f"converged at {told.converged_at:.1f} s"
        damaged = f"; {told.damage}" if told.damage else ""
        return (
            f"Run({self.name!r}, seed {self.seed}: {told.scans:,} scans in {told.duration:.1f} s; {converged}{damaged})"
        )

    def _repr_html_(self) -> str:
        truth = [("where it was", self.scenes.truth, css(palette.TRUTH))]
        paths = [*truth, ("where it was believed to be", self.told.poses, css(palette.ESTIMATE))]
        return figure(map_svg(self.scenes.grid, paths), repr(self))

    def to_pandas(self) -> pd.DataFrame:
        """A row per scan, as ``mcl export RUN -o OUT.csv`` writes them. Raises MclError without pandas."""
        from pipeline.export.tables import scans_table

        table = scans_table(self)
        return data_frame({name: table[name].to_numpy() for name in table.column_names})

    @property
    def name(self) -> str:
        """The log's."""
        return self.told.log

    @property
    def seed(self) -> int:
        """Of its random numbers."""
        return self.told.seed

    @cached_property
    def area(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest (x, y) worth showing, m in the map frame."""
        low, high = self.scenes.grid.known_area
        return low - MARGIN, high + MARGIN

    def at(self, time: float) -> Moment:
        """The moment so many seconds after the first scan; MclError outside of the recording."""
        self.told.pose_at(time)
        row = self.scenes.row_at(time)
        return Moment(row, "", self.sentence(row))

    def sentence(self, row: int) -> str:
        """What happened last until this row, but for the pace of resampling."""
        told = [event for event in self.told.events if event.kind != "resampled"]
        until = [event for event in told if event.time <= self.scenes.times[row] + 1e-9]
        return " ".join(event.text for event in until if event.scan == until[-1].scan)


def read_run(path: Path | str) -> Run:
    """A run's folder or its recording, also a damaged one as far as it goes. Raises MclError as `inspect` does."""
    path, file = open_recording(path)
    told = inspect_file(path, file)
    try:
        return Run(told, read_scenes(file), file)
    except MclError as error:
        raise MclError(error.message, error.hint, path=path) from error


def key_moments(run: Run) -> Sequence[Moment]:
    """Start, what happened to the belief, and the end; of very many such events the first ones."""
    x, y, yaw = run.scenes.estimates[-1]
    start = next((event.text for event in run.told.events), "")
    found: list[Moment] = []
    for event in run.told.events:
        if event.kind not in TITLES:
            continue
        row = run.scenes.row_at(event.time)
        if event.kind == "lost":  # who is found to be lost is set right in the same scan: the one before shows it
            row = max(row - 1, 0)
        if found and found[-1].row == row:
            found[-1] = Moment(row, found[-1].title, f"{found[-1].sentence} {event.text}")
        else:
            found.append(Moment(row, TITLES[event.kind], event.text))
    last = len(run.scenes) - 1
    end = Moment(last, "end", f"The estimate ends at ({x:.2f}, {y:.2f}) m, heading {np.degrees(yaw):.0f} deg.")
    return [Moment(0, "start", start), *found[: MOST - 2], end]


def differing(runs: Sequence[Run]) -> dict[str, tuple[Any, ...]]:
    """The parameters in which the runs are not all alike: every run's value by name, None where it has none."""
    names = dict.fromkeys(name for run in runs for name in run.told.config)
    values = {name: tuple(run.told.config.get(name) for run in runs) for name in names}
    return {name: found for name, found in values.items() if any(value != found[0] for value in found)}
