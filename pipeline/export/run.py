"""A recorded run as it is exported, and the moments of it that are worth a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.inspect import Inspection, inspect_file, open_recording
from pipeline.recording.rrd_file import RrdFile
from pipeline.recording.scenes import Scenes, read_scenes

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
        grid = self.scenes.grid
        rows, columns = np.nonzero(grid.known) if grid.known.any() else np.nonzero(np.isnan(grid.occupancy))
        x, y = ((grid.resolution * np.array([k.min(), k.max() + 1])) for k in (columns, rows))
        corners = grid.to_map([(i, j, 0.0) for i in x for j in y])[:, :2]
        return corners.min(axis=0) - MARGIN, corners.max(axis=0) + MARGIN

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
