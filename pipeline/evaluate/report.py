"""What an evaluation found: per run, per log, and in all."""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.config import Config
from pipeline.data_frame import data_frame
from pipeline.evaluate.aftermath import Aftermath, plain_aftermath
from pipeline.evaluate.agreement import Agreement, agreement
from pipeline.evaluate.failures import ANY, FAILURES
from pipeline.evaluate.metrics import (
    Array,
    Recovery,
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

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Run:
    """One seed on one log: ``poses`` (n, 3) m and rad, base_link in map; ``seconds`` of wall clock by part.

    ``score``: None where nobody knows the truth. ``times`` (n,), ``truth`` (n, 3): of the scans that it was given,
    which faults may have left out or moved; ``faults``: what followed each of them. ``probability`` (n,): that the pose
    is right, as the run stated it at every scan; ``covariances`` (n, 3, 3): of the poses; ``explained`` (n,): shares of
    the beams that the map explains. ``map_changed``: the share of the seen wall that was changed, if any.
    """

    seed: int
    score: Score | None
    poses: Array
    seconds: Mapping[str, float]
    speed: float
    """Seconds of log per second of wall clock."""
    times: Array
    truth: Array
    probability: Array
    covariances: Array
    explained: Array
    faults: tuple[Aftermath, ...] = ()
    map_changed: float | None = None

    def __repr__(self) -> str:
        if self.score is None:
            return f"Run(seed {self.seed}: {len(self.times):,} scans, truth not known)"
        right = f"{100 * self.score.scans_right:.1f} % of the scans right"
        return f"Run(seed {self.seed}: {'succeeds' if self.success else 'fails'}, {right})"

    @property
    def success(self) -> bool:
        """Whether it succeeded; False where nobody knows."""
        return self.score is not None and self.score.success

    @property
    def recoveries(self) -> tuple[Recovery, ...]:
        """What followed each kidnapping."""
        return () if self.score is None else self.score.recoveries

    @property
    def wall(self) -> float:
        """Seconds of wall clock that it took."""
        return float(self.times[-1]) / self.speed

    def to_dict(self) -> dict[str, Any]:
        """As plain values, without the poses."""
        faults = [asdict(fault) for fault in self.faults]
        scored = {} if self.score is None else self.score.to_dict()
        told = {"stated": float(np.mean(self.probability)), "explained": float(np.mean(self.explained))}
        clock = {"wall": self.wall, "speed": self.speed, "seconds": dict(self.seconds)}
        plain = {"seed": self.seed, **scored, **told, **clock}
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

    def __repr__(self) -> str:
        done = f"{self.successes} of {len(self.runs)} runs succeed" if self.scored else f"{len(self.runs)} runs"
        return f"LogEvaluation({self.name!r}: {done}{'' if self.scored else ', truth not known'})"

    @property
    def scored(self) -> bool:
        """Whether the truth is known, so that runs have scores."""
        return self.runs[0].score is not None

    @property
    def duration(self) -> float:
        """Seconds from the log's first scan to its last."""
        return float(self.times[-1])

    @property
    def wall(self) -> float:
        """Seconds of wall clock that a run took, the median."""
        return float(np.median([run.wall for run in self.runs]))

    @cached_property
    def agreement(self) -> Agreement | None:
        """What the runs tell without the truth; None where each had a log of its own, with faults made in it."""
        alike = all(np.array_equal(run.times, self.times) and not run.faults for run in self.runs)
        return agreement(self.runs) if alike else None

    @property
    def successes(self) -> int:
        """Runs that succeeded."""
        return sum(run.success for run in self.runs)

    @property
    def success_rate(self) -> float:
        """Share of the runs that succeeded."""
        return self.successes / len(self.runs)

    @cached_property
    def errors_since_found(self) -> tuple[Array, Array]:
        """Position errors (m) and heading errors (degrees) since the robot was found, the scans of all runs in one."""
        position, heading = [np.zeros(0)], [np.zeros(0)]
        for run in self.runs if self.scored else ():
            errors, kidnapped_at = pose_errors(run.poses, run.truth), [r.kidnapped_at for r in run.recoveries]
            since_found = search(run.times, is_localized(*errors), known(run.truth), kidnapped_at)[1]
            position.append(errors[0][since_found])
            heading.append(np.degrees(errors[1][since_found]))
        return np.concatenate(position), np.concatenate(heading)

    @property
    def recoveries(self) -> list[tuple[float, int, Summary | None]]:
        """For each kidnapping: when it was (s), the runs that recovered, and after how many seconds."""
        by_kidnapping = [
            (at, [r for run in self.runs for r in run.recoveries if r.kidnapped_at == at])
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
        scores = [run.score for run in self.runs if run.score is not None]
        return Summary.of([number for score in scores if (number := value(score)) is not None])

    def to_dict(self) -> dict[str, Any]:
        """As plain values: metres, degrees, seconds; None where no run has the figure.

        Errors are those since the robot was found, pooled over the scans of all runs; every other summary is over runs.
        Where the truth is not known there is only what the runs tell of themselves.
        """
        told = {} if self.agreement is None else {"agreement": self.agreement.to_dict()}
        clock = {"duration": self.duration, "wall": self.wall, "speed": self.speed}
        seeds = [run.to_dict() for run in self.runs]
        if not self.scored:
            return {"runs": len(self.runs), "successes": None, **told, **clock, "seeds": seeds}
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
            "false_alarms": sum(run.score.false_alarms for run in self.runs if run.score is not None),
            "hindsight_start_position_error": _plain(
                self.over_runs(lambda score: score.hindsight_start_position_error)
            ),
            "hindsight_ate": _plain(self.over_runs(lambda score: score.hindsight_ate)),
            **told,
            **clock,
            "seeds": seeds,
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

    def __repr__(self) -> str:
        return f"Evaluation({', '.join(repr(log) for log in self.logs)})"

    def to_pandas(self) -> pd.DataFrame:
        """A row per log and seed: what ``Run.to_dict`` tells, but for lists. Raises MclError without pandas."""
        return runs_frame([({}, self)])

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


def runs_frame(labelled: Sequence[tuple[Mapping[str, str], Evaluation]]) -> pd.DataFrame:
    """A row per log, evaluation and seed, with what tells evaluations apart. Raises MclError without pandas."""
    rows = [
        {"log": log.name, **labels, **_flat(run.to_dict())}
        for labels, evaluation in labelled
        for log in evaluation.logs
        for run in log.runs
    ]
    names = dict.fromkeys(name for row in rows for name in row)
    return data_frame({name: [row.get(name) for row in rows] for name in names})


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """The same without mappings in it, whose keys are joined to their own name by an underscore, and without lists."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{key}_")
        elif not isinstance(value, list | tuple):
            flat[f"{prefix}{key}"] = value
    return flat


def _plain(summary: Summary | None) -> dict[str, float] | None:
    return None if summary is None else asdict(summary)
