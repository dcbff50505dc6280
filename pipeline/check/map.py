"""Whether the map can be the building's: what it says by itself, and whether any place in it explains the scans."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.check.findings import Finding
from pipeline.config import Config
from pipeline.localization import localize
from pipeline.logs.messages import Log
from pipeline.logs.plausibility import doubt_truth
from pipeline.mirrored import PLAINLY, SECONDS, mirrored

EXPLAINED = 0.55
"""Share of the beams that the right map explains at least: below it `mcl localize` warns as well."""
UNKNOWN = 0.98
"""Share of the map that is unknown from which on it is hardly one; maps of one room on a large sheet have 0.9."""
SPARSE = 0.1
"""Particles per square metre of free floor below which a start at random may miss the robot."""
SPARSE_AT_RANDOM = 10.0
"""The same where the start does not look at the first scan (init free_space or map)."""


@dataclass(frozen=True)
class Tried:
    """How much of the beams the map explains when the robot is looked for: ``explained``, and what was found."""

    explained: float
    findings: tuple[Finding, ...]


def findings_of_map(log: Log, config: Config) -> Iterator[Finding]:
    """What the map by itself, and with the parameters, leaves to doubt."""
    grid = log.grid
    if grid is None:
        yield Finding("noted", "map", "There is no map.", "Give one with --map, and it is looked at as well.")
        return
    occupied, free = grid.occupied(config.occupied_threshold), grid.free(config.free_threshold)
    n_occupied, n_free = int(occupied.sum()), int(free.sum())
    area = n_free * grid.resolution**2
    if not n_occupied:
        yield Finding(
            "broken", "map", f"No cell of the map is occupied by {100 * config.occupied_threshold:.0f} % or more: "
            "it has "
            "no walls.",
            "Is it the right file? If its walls are grey, lower occupied_threshold.",
        )  # fmt: skip
    if not n_free:
        yield Finding(
            "broken", "map", f"No cell of the map is less than {100 * config.free_threshold:.0f} % occupied: no "
            "robot can "
            "stand anywhere.",
            "Is it the right file? Look at negate and free_thresh in its YAML, or raise free_threshold.",
        )  # fmt: skip
    if not n_occupied or not n_free:
        return
    if n_occupied > n_free:
        yield Finding(
            "doubtful", "map", f"More of the map is occupied ({n_occupied:,} cells) than free ({n_free:,}).",
            "Is it drawn white on black? Then set negate: 1 in its YAML.",
        )  # fmt: skip
    unknown = 1.0 - float(grid.known.mean())
    if unknown > UNKNOWN:
        yield Finding("noted", "map", f"{100 * unknown:.1f} % of the map is unknown.", "Cut it to the building.")
    if config.init == "pose":
        yield from _initial_pose(log, config)
        return
    per_metre = config.max_particles / area
    sparse = SPARSE if config.init == "exhaustive" else SPARSE_AT_RANDOM
    if per_metre < sparse:
        yield Finding(
            "doubtful", "parameters",
            f"max_particles = {config.max_particles:,} are {per_metre:.2g} for each of the {area:,.0f} square "
            "metres of "
            "free floor.",
            f"Raise it to {math.ceil(sparse * area / 1000) * 1000:,} or more, or begin at --pose X,Y,YAW.",
        )  # fmt: skip
    if config.min_particles > config.max_particles:
        yield Finding(
            "noted", "parameters",
            f"min_particles = {config.min_particles:,} is more than max_particles = {config.max_particles:,}, which "
            "counts.",
            "Lower min_particles.",
        )  # fmt: skip


def findings_of_truth(log: Log) -> Iterator[Finding]:
    """Whether the truth that travels with the log can be its own."""
    if doubt := doubt_truth(log):
        yield Finding("doubtful", "truth", f"{doubt[:1].upper()}{doubt[1:]}.", "Give the right one to --ground-truth.")


def place(log: Log, config: Config, seed: int = 0) -> Tried:
    """Look for the robot in the map over the first two minutes; where nothing is found, with scans that are mirrored.

    A laser that is turned on its mount would be found in the map all the same, and the robot with it: that is told by
    the wheels. Of these minutes the second half counts: by then a robot that can be found is. Raises MclError as
    `localize` does.
    """
    explained = _explained(log, config, seed)
    if explained >= EXPLAINED:
        return Tried(explained, ())
    found = f"the map explains {100 * explained:.0f} % of the beams, where a right one explains {100 * EXPLAINED:.0f} %"
    if mirrored(log, config, explained, seed):
        text = f"The scans are mirrored: as they are, {found}; read from last beam to first it explains far more."
        do = "The laser is mounted upside down: say so in its transform (a roll of pi)."
        return Tried(explained, (Finding("broken", "laser", text, do),))
    text = f"No place in the map explains the scans: at best, {found}."
    do = (
        "Is it the map of this building, of this floor, with the right resolution? Or is the laser, or its mount, not "
        "what the log says?"
    )
    grade = "broken" if explained < EXPLAINED - PLAINLY else "doubtful"
    return Tried(explained, (Finding(grade, "map", text, do),))  # type: ignore[arg-type]


def _explained(log: Log, config: Config, seed: int) -> float:
    n = max(1, int(np.searchsorted(log.times, SECONDS)))
    start = dataclasses.replace(
        log,
        stamps=log.stamps[:n],
        odometry=log.odometry[:n],
        ranges=log.ranges[:n],
        sweeps=None if log.sweeps is None else log.sweeps[:n],
        turns=None if log.turns is None else log.turns[:n],
        stretches=None if log.stretches is None else log.stretches[:n],
        ground_truth=None,
    )
    result = localize(start, config, seed=seed)
    return float(np.mean(result.explained[n // 2 :]))


def _initial_pose(log: Log, config: Config) -> Iterator[Finding]:
    assert log.grid is not None
    assert config.initial_pose is not None
    col, row, _ = (log.grid.to_grid(config.initial_pose) / log.grid.resolution).tolist()
    inside = 0 <= col < log.grid.width and 0 <= row < log.grid.height
    if not inside or not log.grid.free(config.free_threshold)[int(row), int(col)]:
        x, y, _ = config.initial_pose
        yield Finding(
            "doubtful", "parameters", f"The robot is to begin at x = {x:g} m, y = {y:g} m, where the map has no "
            "free floor.",
            "Give another --pose.",
        )  # fmt: skip
