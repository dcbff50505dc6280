"""Runs side by side: their figures, what differs in their configurations, and where their estimates part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluate.metrics import pose_errors
from pipeline.export.run import Run

APART = 0.5
"""Metres between two estimates from which on they are said to part."""
APART_TURN = float(np.deg2rad(10.0))
"""Radians, likewise."""


@dataclass(frozen=True)
class Figures:
    """What came out of a run; None where it is not known.

    Times are s of the log but for ``wall``, which is s of the machine; errors are m against the truth as drawn (4 mm),
    ``error`` the median from convergence on; ``explained`` is a share of the beams.
    """

    log: str
    seed: int
    scans: int
    duration: float
    converged_at: float | None
    lost: int
    found: int
    explained: float | None
    error: float | None
    end_error: float | None
    particles: int
    wall: float | None


def figures(run: Run) -> Figures:
    """What the recording alone tells."""
    told, scenes = run.told, run.scenes
    kinds = [event.kind for event in told.events]
    since = told.times >= (0.0 if told.converged_at is None else told.converged_at)
    error = errors(run)[0]
    known = error[since & ~np.isnan(error)]
    explained = scenes.curves["explained"][since]
    return Figures(
        log=told.log,
        seed=told.seed,
        scans=told.scans,
        duration=told.duration,
        converged_at=told.converged_at,
        lost=kinds.count("lost"),
        found=kinds.count("found"),
        explained=float(np.nanmean(explained)) if (~np.isnan(explained)).any() else None,
        error=float(np.median(known)) if len(known) else None,
        end_error=None if np.isnan(error[-1]) else float(error[-1]),
        particles=int(np.nan_to_num(scenes.curves["particles"][-1])),
        wall=sum(told.timings.values()) or None,
    )


FIGURES: tuple[tuple[str, Callable[[Figures], str]], ...] = (
    ("scans", lambda f: f"{f.scans:,}"),
    ("duration", lambda f: f"{f.duration:.1f} s"),
    ("converged", lambda f: "never" if f.converged_at is None else f"{f.converged_at:.1f} s"),
    ("lost", lambda f: f"{f.lost}"),
    ("found", lambda f: f"{f.found}"),
    ("explained", lambda f: _or_dash(f.explained, lambda v: f"{100 * v:.0f} %")),
    ("error", lambda f: _or_dash(f.error, lambda v: f"{v:.2f} m")),
    ("at the end", lambda f: _or_dash(f.end_error, lambda v: f"{v:.2f} m")),
    ("particles", lambda f: f"{f.particles:,}"),
    ("wall", lambda f: _or_dash(f.wall, lambda v: f"{v:.1f} s")),
)
"""What is told of a run, and how."""


def errors(run: Run) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position (m) and heading (rad) error of every scan, (n,) each; NaN where the truth is not known."""
    return pose_errors(run.scenes.estimates, run.scenes.truth)


def _or_dash(value: float | None, show: Callable[[float], str]) -> str:
    return "-" if value is None else show(value)
