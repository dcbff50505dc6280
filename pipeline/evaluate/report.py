"""What an evaluation found: per run, per log, and as the tables that people compare."""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from pipeline.config import Config
from pipeline.evaluate.aftermath import Aftermath, Row, aftermath_row, plain_aftermath
from pipeline.evaluate.failures import ANY, FAILURES
from pipeline.evaluate.metrics import (
    Array,
    Score,
    Summary,
    is_localized,
    known,
    pose_errors,
    search,
    wilson_interval,
)
from pipeline.evaluate.perturbed import Change
from pipeline.maps.occupancy_grid import OccupancyGrid

COLUMNS = (
    "log",
    "success",
    "95 % CI",
    "found (s)",
    "p95",
    "error (m)",
    "p95",
    "RMSE",
    "(deg)",
    "p95",
    "right (%)",
    "after (%)",
    "ATE (m)",
    "speed",
)
"""Headings of ``table``: medians, but for p95 and RMSE of what is to their left.

"right": scans localized, of all from the first one on; "after": of those since the robot was found.
"""
COMPARE_COLUMNS = ("log", "configuration", *COLUMNS[1:])
"""Headings of ``compare_table``."""
RECOVERY_COLUMNS = ("log", "kidnapped at (s)", "recovered", "after (s)", "p95")
"""Headings of ``recovery_table``."""
CHANGE_COLUMNS = ("log", "map", "asked (%)", "changed (%)", "least", "most")
"""Headings of ``change_table``: of the seen wall; changed: mean over runs."""
CERTAIN_COLUMNS = ("log", "certain", "after (s)", "p95")
"""Headings of ``certainty_table``."""


@dataclass(frozen=True)
class Run:
    """One seed on one log: ``poses`` (n, 3) m and rad, base_link in map; ``seconds`` of wall clock by part.

    ``times`` (n,), ``truth`` (n, 3): of the scans that it was given, which faults may have left out or moved;
    ``faults``: what followed each of them. ``probability`` (n,): that the pose is right, as the run stated it at every
    scan; ``covariances`` (n, 3, 3): of the poses. ``map_changed``: the share of the seen wall that was changed, if any.
    """

    seed: int
    score: Score
    poses: Array
    seconds: Mapping[str, float]
    speed: float
    """Seconds of log per second of wall clock."""
    times: Array
    truth: Array
    probability: Array
    covariances: Array
    faults: tuple[Aftermath, ...] = ()
    map_changed: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """As plain values, without the poses."""
        faults = [asdict(fault) for fault in self.faults]
        plain = {"seed": self.seed, **self.score.to_dict(), "speed": self.speed, "seconds": dict(self.seconds)}
        changed = {} if self.map_changed is None else {"map_changed": self.map_changed}
        return plain | ({"faults": faults} if faults else {}) | changed


@dataclass(frozen=True)
class LogEvaluation:
    """All runs on one log: ``times`` (n,) seconds since the first scan; ``truth`` (n, 3) m, rad, NaN where unknown."""

    name: str
    times: Array
    truth: Array
    kidnapped_at: tuple[float, ...]
    grid: OccupancyGrid | None
    runs: tuple[Run, ...]

    @property
    def successes(self) -> int:
        """Runs that succeeded."""
        return sum(run.score.success for run in self.runs)

    @property
    def success_rate(self) -> float:
        """Share of the runs that succeeded."""
        return self.successes / len(self.runs)

    @cached_property
    def errors_since_found(self) -> tuple[Array, Array]:
        """Position errors (m) and heading errors (degrees) since the robot was found, the scans of all runs in one."""
        position, heading = [np.zeros(0)], [np.zeros(0)]
        for run in self.runs:
            errors, kidnapped_at = pose_errors(run.poses, run.truth), [r.kidnapped_at for r in run.score.recoveries]
            since_found = search(run.times, is_localized(*errors), known(run.truth), kidnapped_at)[1]
            position.append(errors[0][since_found])
            heading.append(np.degrees(errors[1][since_found]))
        return np.concatenate(position), np.concatenate(heading)

    @property
    def recoveries(self) -> list[tuple[float, int, Summary | None]]:
        """For each kidnapping: when it was (s), the runs that recovered, and after how many seconds."""
        by_kidnapping = [
            (at, [r for run in self.runs for r in run.score.recoveries if r.kidnapped_at == at])
            for at in sorted(self.kidnapped_at)
        ]
        return [
            (at, sum(r.recovered for r in these), Summary.of([r.time for r in these if r.time is not None]))
            for at, these in by_kidnapping
        ]

    @property
    def faults(self) -> list[tuple[str, list[Aftermath]]]:
        """For each fault by its name: what followed, in all runs; of the protocol's failures also all together."""
        names: dict[str, list[Aftermath]] = {}
        for run in self.runs:
            for fault in run.faults:
                names.setdefault(fault.fault, []).append(fault)
        failures = [fault for name in FAILURES for fault in names.get(name, [])]
        return [*sorted(names.items()), *([(ANY, failures)] if failures else [])]

    @property
    def speed(self) -> float:
        """Seconds of log per second of wall clock, the median over runs."""
        return float(np.median([run.speed for run in self.runs]))

    def over_runs(self, value: Callable[[Score], float | None]) -> Summary | None:
        """Summary, over the runs that have it, of one number of their scores."""
        return Summary.of([number for run in self.runs if (number := value(run.score)) is not None])

    def to_dict(self) -> dict[str, Any]:
        """As plain values: metres, degrees, seconds; None where no run has the figure.

        Errors are those since the robot was found, pooled over the scans of all runs; every other summary is over runs.
        """
        position, heading = (Summary.of(errors) for errors in self.errors_since_found)
        recoveries = [
            {"kidnapped_at": at, "recovered": recovered, "time": _plain(time)}
            for at, recovered, time in self.recoveries
        ]
        return {
            "runs": len(self.runs),
            "successes": self.successes,
            "success_rate": self.success_rate,
            "success_interval": list(wilson_interval(self.successes, len(self.runs))),
            "time_to_localize": _plain(self.over_runs(lambda score: score.time_to_localize)),
            "certain_at": _plain(self.over_runs(lambda score: score.certain_at)),
            "position_error": _plain(position),
            "heading_error": _plain(heading),
            "scans_right": _plain(self.over_runs(lambda score: score.scans_right)),
            "localized": _plain(self.over_runs(lambda score: score.localized)),
            "localized_after": _plain(self.over_runs(lambda score: score.localized_after)),
            "ate": _plain(self.over_runs(lambda score: score.ate)),
            "ate_after": _plain(self.over_runs(lambda score: score.ate_after)),
            "recoveries": recoveries,
            **({"faults": faults} if (faults := [plain_aftermath(*each) for each in self.faults]) else {}),
            "false_alarms": sum(run.score.false_alarms for run in self.runs),
            "hindsight_start_position_error": _plain(
                self.over_runs(lambda score: score.hindsight_start_position_error)
            ),
            "hindsight_ate": _plain(self.over_runs(lambda score: score.hindsight_ate)),
            "speed": self.speed,
            "seeds": [run.to_dict() for run in self.runs],
        }


@dataclass(frozen=True)
class Evaluation:
    """What ``evaluate`` returns: one entry per log, the configuration, and the versions that ran it.

    ``failures``: per metre, where the protocol made some; ``change``: what was asked of the maps.
    """

    logs: tuple[LogEvaluation, ...]
    config: Config
    versions: Mapping[str, str]
    failures: float | None = None
    change: Change | None = None

    def to_dict(self) -> dict[str, Any]:
        """As plain values, ready for JSON; two logs of the same name are told apart by a number."""
        logs: dict[str, Any] = {}
        for log in self.logs:
            name = log.name
            while name in logs:
                name = f"{log.name} ({sum(key.startswith(log.name) for key in logs) + 1})"
            logs[name] = log.to_dict()
        failures = {} if self.failures is None else {"failures": self.failures}
        change = {} if self.change is None else {"change": asdict(self.change)}
        config = self.config.model_dump(mode="json")
        return {"logs": logs, **failures, **change, "config": config, "versions": dict(self.versions)}


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide a result."""
    found = {"python": platform.python_version()}
    for package in ("mcl-replay", "numpy", "numba", "scipy"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "unknown"
    return found


# --- tables -------------------------------------------------------------------------------------------------------


def table(evaluation: Evaluation) -> list[Row]:
    """One row of strings per log, under COLUMNS."""
    return [_row(log) for log in evaluation.logs]


def compare_table(evaluations: Sequence[tuple[str, Evaluation]]) -> list[Row]:
    """Log by log one row of strings per named evaluation, under COMPARE_COLUMNS."""
    names = dict.fromkeys(log.name for _, evaluation in evaluations for log in evaluation.logs)
    return [
        (name, label, *_row(log)[1:])
        for name in names
        for label, evaluation in evaluations
        for log in evaluation.logs
        if log.name == name
    ]


def recovery_table(evaluation: Evaluation) -> list[Row]:
    """One row of strings per log and kidnapping, under RECOVERY_COLUMNS; empty where nobody was kidnapped."""
    return [
        (log.name, f"{at:.1f}", f"{recovered}/{len(log.runs)}", *_figures(time, ".1f", "median", "p95"))
        for log in evaluation.logs
        for at, recovered, time in log.recoveries
    ]


def fault_table(evaluation: Evaluation) -> list[Row]:
    """One row of strings per log and fault, under FAULT_COLUMNS; empty where there were none."""
    return [(log.name, *aftermath_row(*each)) for log in evaluation.logs for each in log.faults]


def change_table(evaluation: Evaluation) -> list[Row]:
    """One row of strings per log, under CHANGE_COLUMNS: how much of the seen wall was changed; empty if none was."""
    if (change := evaluation.change) is None:
        return []
    return [
        (log.name, change.kind, f"{100 * change.share:g}",
         *(f"{100 * share:.1f}" for share in (sum(shares) / len(shares), min(shares), max(shares))))
        for log in evaluation.logs
        if (shares := [run.map_changed or 0.0 for run in log.runs])
    ]  # fmt: skip


def certainty_table(evaluation: Evaluation) -> list[Row]:
    """One row of strings per log, under CERTAIN_COLUMNS: in how many runs 90 % of the belief came to the true place."""
    return [
        (log.name, f"{sum(run.score.certain_at is not None for run in log.runs)}/{len(log.runs)}",
         *_figures(log.over_runs(lambda score: score.certain_at), ".1f", "median", "p95"))
        for log in evaluation.logs
    ]  # fmt: skip


def _row(log: LogEvaluation) -> Row:
    position, heading = (Summary.of(errors) for errors in log.errors_since_found)
    low, high = wilson_interval(log.successes, len(log.runs))
    return (
        log.name,
        f"{log.successes}/{len(log.runs)}",
        f"{100 * low:.0f}-{100 * high:.0f}",
        *_figures(log.over_runs(lambda score: score.time_to_localize), ".1f", "median", "p95"),
        *_figures(position, ".2f", "median", "p95", "rmse"),
        *_figures(heading, ".1f", "median", "p95"),
        *_figures(log.over_runs(lambda score: score.scans_right), ".1%", "median"),
        *_figures(log.over_runs(lambda score: score.localized_after), ".1%", "median"),
        *_figures(log.over_runs(lambda score: score.ate), ".2f", "median"),
        f"{log.speed:.0f}",
    )


def _figures(summary: Summary | None, form: str, *names: str) -> Row:
    return tuple("-" if summary is None else format(getattr(summary, name), form).rstrip("%") for name in names)


def _plain(summary: Summary | None) -> dict[str, float] | None:
    return None if summary is None else asdict(summary)
