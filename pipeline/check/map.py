"""Whether the map can be the building's: what it says by itself, and whether any place in it explains the scans."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.check.findings import Finding, Grade
from pipeline.config import Config
from pipeline.judgement.verdict import TRUSTED
from pipeline.localization import localize
from pipeline.logs.messages import Log
from pipeline.logs.plausibility import doubt_truth
from pipeline.mirrored import PLAINLY, SECONDS, mirrored

KNOWN = 0.1
"""Share of the scans that are found, or off the map and known to be there, below which the robot is not found, as
`mcl localize` has it: 0.5 to 1 in nine logs on their own maps, 0 on maps of other buildings."""
EXPLAINED = 0.55
"""Share of the beams below which the map is doubted even if the verdict is sure, as it was in a quarter of the scans of
a laser that hung upside down. A larger share proves nothing: the map of another building explained 0.55 as well."""
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
    wall = grid.wall_threshold(config.occupied_threshold)
    occupied, free = grid.occupied(wall), grid.free(config.free_threshold)
    n_occupied, n_free = int(occupied.sum()), int(free.sum())
    area = n_free * grid.resolution**2
    if not n_occupied:
        yield Finding(
            "broken", "map",
            f"No cell of the map is occupied by {100 * wall:.0f} % or more: it has no walls.",
            "Is it the right file? If its walls are grey, lower occupied_threshold.",
        )  # fmt: skip
    if not n_free:
        yield Finding(
            "broken", "map",
            f"No cell of the map is less than {100 * config.free_threshold:.0f} % occupied: no robot can stand "
            "anywhere.",
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
            f"max_particles = {config.max_particles:,} are {per_metre:.2g} for each of the {area:,.0f} square metres "
            "of free floor.",
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
    """Look for the robot in the map over the first two minutes; where it is not found, with scans that are mirrored.

    A laser that is turned on its mount would be found in the map all the same, and the robot with it: that is told by
    the wheels. Of these minutes the second half counts: by then a robot that can be found is. Raises MclError as
    `localize` does.
    """
    n = int(np.searchsorted(log.times, SECONDS))
    result = localize(log.part(slice(n)), config, seed=seed)
    explained = float(np.mean(result.explained[n // 2 :]))
    known = np.mean([verdict in TRUSTED for verdict in result.verdicts[n // 2 :]])
    if known >= KNOWN and explained >= EXPLAINED:
        return Tried(explained, ())
    share = f"the map explains {100 * explained:.0f} % of the beams"
    if mirrored(log, config, explained, seed):
        text = f"The scans are mirrored: as they are, {share}; read from last beam to first it explains far more."
        do = "The laser is mounted upside down: say so in its transform (a roll of pi)."
        return Tried(explained, (Finding("broken", "laser", text, do),))
    if explained < EXPLAINED:
        text = f"No place in the map explains the scans: at best, {share}, a right one {100 * EXPLAINED:.0f} %."
    else:
        text = f"The robot is not found in the map: where it is taken to be, {share}, but other places may be right."
    do = (
        "Is it the map of this building, of this floor, with the right resolution? Or is the laser, or its mount, not "
        "what the log says?"
    )
    grade: Grade = "broken" if explained < EXPLAINED - PLAINLY else "doubtful"
    return Tried(explained, (Finding(grade, "map", text, do),))


def _initial_pose(log: Log, config: Config) -> Iterator[Finding]:
    assert log.grid is not None
    assert config.initial_pose is not None
    col, row, _ = (log.grid.to_grid(config.initial_pose) / log.grid.resolution).tolist()
    inside = 0 <= col < log.grid.width and 0 <= row < log.grid.height
    if not inside or not log.grid.free(config.free_threshold)[int(row), int(col)]:
        x, y, _ = config.initial_pose
        yield Finding(
            "doubtful", "parameters",
            f"The robot is to begin at x = {x:g} m, y = {y:g} m, where the map has no free floor.",
            "Give another --pose.",
        )  # fmt: skip
