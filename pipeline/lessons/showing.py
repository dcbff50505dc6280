"""One step of a filter that uses a lesson's function, as a recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.filter.substeps import SubStep
from pipeline.lessons.drive import embedded_drive
from pipeline.lessons.exam import Function
from pipeline.lessons.judging import run_on_log
from pipeline.lessons.lesson import Lesson
from pipeline.lessons.written import Written, within
from pipeline.recording.substeps import write_substeps

SETTLED = 2
"""Scans before the one that is shown: at the first ones the particles are still where they were put."""


def record_step(lesson: Lesson, function: Function, path: Path, patience: float) -> None:
    """Write a recording of one scan's sub-steps, with this function in the place of the lesson's own.

    A scan is chosen at which as much as possible happens, and of those the one at which least is known. Raises MclError
    where the function fails, takes longer than ``patience`` s, or nothing can be written.
    """
    steps: list[SubStep] = []
    if isinstance(function, Written):
        with within(patience, function.path, function.name):
            run_on_log(lesson, function, steps)
    else:
        run_on_log(lesson, function, steps)
    parts: dict[int, list[SubStep]] = {}
    for step in steps:
        parts.setdefault(step.scan, []).append(step)
    chosen = max(list(parts)[SETTLED:], key=lambda scan: (len(parts[scan]), _spread(parts[scan][-1])))
    drive = embedded_drive()
    shown = parts[chosen]
    truth = drive.grid.to_map(drive.truth[[step.scan for step in shown]])
    write_substeps(path, f"lesson-{lesson.name}-scan{chosen}", drive.grid, shown, truth)


def _spread(step: SubStep) -> float:
    """How far apart the particles are, m; 0 for a Gaussian."""
    return float(np.hypot(*step.poses[:, :2].std(axis=0))) if len(step.poses) else 0.0
