"""What came out of a run, in lines: printed when it has ended."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline import console
from pipeline.cli.lines import facts, look_at, percent

if TYPE_CHECKING:
    from pipeline.evaluate.metrics import Score
    from pipeline.filter.step import Event
    from pipeline.logs.messages import Log
    from pipeline.replay import Replay

DOUBTFUL = 0.1
"""Share of the scans in the second half of a run that are found, or off the map, below which a summary warns.

Measured in six buildings: 0.86 to 1 where the robot was found, 0.3 where it was carried off or drove off the map for
long, and 0 on the map of another building or where it was lost (docs/verdict.md).
"""

_REMARKS = ("laser_at_centre", "imu_unused", "imu_left_out")
"""What `mcl convert` says of a recording as the reader would, and what is still true of its log."""


def report(run: Replay, map_path: Path | None = None, config: str | None = None) -> None:
    """Print what came out of a run; ``map_path`` and ``config`` as they were given."""
    x, y, yaw = run.result.poses[-1]
    converged = run.result.converged_at
    parts = ", ".join(f"{part} {seconds:.2f}" for part, seconds in run.seconds.items())
    rows = [
        ("scans", f"{len(run.log):,} in {run.log.duration:.1f} s"),
        *_as_read(run.log),
        ("converged", "never" if converged is None else f"at {converged:.1f} s"),
        *((event.kind, f"at {at:.1f} s") for _, at, event in run.result.events if event.kind in ("lost", "found")),
        *_of_the_way(run.result.events),
        ("scans by verdict", _verdicts(run.result.verdicts)),
        ("at the end", f"{run.result.verdicts[-1]}: right with probability {run.result.probability[-1]:.2f}"),
        *_memory(run),
        ("end pose", f"x {x:.2f} m, y {y:.2f} m, yaw {math.degrees(yaw):.1f} deg"),
        ("explained by the map", f"{percent(run.explained)} of the beams"),
        *_against_truth(run.score),
        ("wall time", f"{sum(run.seconds.values()):.2f} s for {run.log.duration:.1f} s of the log ({parts})"),
        ("speed", f"{run.speed:.0f} times real time"),
    ]
    console.note(facts(f"{run.log.name}, seed {run.seed}", rows))
    if run.known_late < DOUBTFUL:
        console.note(
            f"warning: do not trust this: in the second half of the run the robot is found in "
            f"{percent(run.known_late)} of the scans, and {_map_name(run.log, map_path)} explains "
            f"{percent(run.explained_late)} of the beams; {_why(run, config)}"
        )
    if run.recorded:
        console.note(look_at(run.folder.recording))


def _memory(run: Replay) -> list[tuple[str, str]]:
    """What the run began with, if it was given a memory."""
    import numpy as np

    if run.began_with is None:
        return []
    logs, cells = len(run.began_with.logs), int(np.count_nonzero(run.began_with.changed))
    heard = "" if run.result.seen is not None else "; this filter does not use it"
    return [
        ("began with", f"what {logs} {'log' if logs == 1 else 'logs'} showed: {cells:,} cells are not as mapped{heard}")
    ]


def _verdicts(kinds: Sequence[str]) -> str:
    """The shares of the verdicts on all scans."""
    from pipeline.judgement.verdict import KINDS

    return ", ".join(f"{kind} {percent(kinds.count(kind) / len(kinds))}" for kind in KINDS if kind in kinds)


def _of_the_way(events: Sequence[tuple[int, float, Event]]) -> list[tuple[str, str]]:
    """What was wrong with the log's word of the way: one row of each kind."""
    from pipeline.motion.faults import KINDS

    rows = []
    for kind in ("gap", *KINDS):
        if told := [event.text for _, _, event in events if event.kind == kind]:
            more = f" (and {len(told) - 1} more of these)" if len(told) > 1 else ""
            rows.append((kind.replace("_", " "), told[0] + more))
    return rows


def _why(run: Replay, config: str | None) -> str:
    """What it may be when a map explains too little: what can be tried is tried first."""
    from pipeline.config import load_config
    from pipeline.mirrored import mirrored

    if mirrored(run.log, load_config(run.folder.config), run.explained_late, run.seed):
        return (
            "it explains far more of scans that are read from their last beam to their first: is the laser upside down?"
        )
    if any(event.kind == "turned" for _, _, event in run.result.events):
        return "is the laser mounted otherwise than the log says, as the wheels have it?"
    return "is it another building's" + (
        f", or are the parameters (--config {config}) another robot's?" if config else "?"
    )


def _as_read(log: Log) -> list[tuple[str, str]]:
    """What the reader chose in somebody else's recording, and what of any log it had to leave out or change."""
    from pipeline.logs import schema

    source, told = log.metadata.get(schema.SOURCE, {}), log.metadata.get(schema.READER, {})
    remarks = {key: source[key] for key in _REMARKS if key in source} | dict(told)
    left_out, resampled = int(told.get("scans_outside_odometry", 0)), int(told.get("scans_resampled", 0))
    rows = []
    if not source and told:
        topics = [told[key] for key in ("scan_topic", "odometry_topic", "imu_topic") if told.get(key)]
        frames = told["frames"] if log.wheels else told["frames"].partition(" -> ")[2]
        rows.append(("read from", f"{', '.join(topics)}; {frames}"))
    if not log.wheels:
        at_centre = (
            f"; the laser is taken to be at its centre: {why}" if (why := remarks.get("laser_at_centre")) else ""
        )
        rows.append(("odometry", f"none: only the scans tell how the robot moved{at_centre}"))
    if left_out:
        rows.append(("left out", f"{left_out:,} of the scans: before the odometry begins or after it ends"))
    if resampled:
        rows.append(("resampled", f"{resampled:,} of the scans: their beams differ from the others'"))
    if wrong := told.get("beam_times_unused"):
        rows.append(("beam times", f"not used: {wrong}"))
    if wrong := remarks.get("imu_unused"):
        rows.append(("gyroscope", f"not used: {wrong}"))
    elif left_out := int(remarks.get("imu_left_out", 0)):
        rows.append(("gyroscope", f"{left_out:,} of its messages left out: no turn rates"))
    return rows


def _map_name(log: Log, map_path: Path | None) -> str:
    from pipeline.logs import schema

    own = log.metadata.get(schema.MAP_SOURCE, {})
    return f"the map {map_path or own.get('file') or own.get('topic') or 'in the log'}"


def _against_truth(score: Score | None) -> list[tuple[str, str]]:
    if score is None:
        return []
    found, position, heading = score.time_to_localize, score.position_error, score.heading_error
    rows = [("true: found", "never" if found is None else f"after {found:.1f} s")]
    rows.append(("true: scans right", f"{100 * score.scans_right:.1f} % of all: within 0.5 m and 10 deg"))
    if position is not None and heading is not None:
        rows.append(("true: error since", f"{position.median:.2f} m, {heading.median:.1f} deg (median)"))
        rows.append(("true: 95 % below", f"{position.p95:.2f} m, {heading.p95:.1f} deg"))
    for recovery in score.recoveries:
        again = "never found again" if recovery.time is None else f"found again after {recovery.time:.1f} s"
        rows.append(("true: carried off", f"at {recovery.kidnapped_at:.1f} s, {again}"))
    rows.append(("true: error at the end", f"{score.end_position_error:.2f} m, {score.end_heading_error:.1f} deg"))
    if score.hindsight_ate is not None:
        rows.append(("true: error in hindsight", f"{score.hindsight_ate:.2f} m (RMSE over all scans)"))
    return rows
