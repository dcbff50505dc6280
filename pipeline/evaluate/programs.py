"""Evaluations as programs ask for them: logs and configurations by name, runs one after the other in this process."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pipeline.config import Config, load_config
from pipeline.errors import MclError
from pipeline.evaluate.report import Evaluation
from pipeline.evaluate.runs import compare, evaluate
from pipeline.evaluate.variants import Comparison, Variant
from pipeline.logs.messages import Log, Trajectory

NAME = "configuration"
"""What a comparison calls the names of its configurations."""


def evaluate_logs(
    logs: Log | Sequence[Log],
    config: Config | None = None,
    *,
    references: Sequence[Trajectory | None] = (),
    runs: int = 20,
    seed: int = 0,
    jobs: int = 1,
) -> Evaluation:
    """Localize logs with the seeds seed, seed + 1, ... and score every run, as `mcl evaluate` does.

    ``references``: one per log, of base_link in the map frame; the logs' own truth if none are given, and where nobody
    knows it, ``LogEvaluation.agreement`` has what the runs tell of themselves. ``jobs``: processes, in which the result
    is the same; a script that asks for more than one must begin its work under ``if __name__ == "__main__":``.
    Raises MclError for a reference that does not overlap its log in time, and what the runs raise.
    """
    logs = [logs] if isinstance(logs, Log) else list(logs)
    truths = list(references) or [None] * len(logs)
    return evaluate(logs, truths, config or load_config(), runs, jobs, seed)


def compare_configs(
    logs: Log | Sequence[Log],
    configs: Mapping[str, Config],
    *,
    references: Sequence[Trajectory | None] = (),
    runs: int = 20,
    seed: int = 0,
    jobs: int = 1,
) -> Comparison:
    """Evaluate every configuration with the same logs and seeds; ``Comparison.paired`` tests each against the first.

    Everything else as ``evaluate_logs``. Raises MclError for fewer than two configurations.
    """
    if len(configs) < 2:
        raise MclError(f"a comparison is of two configurations or more, not of {len(configs)}")
    logs = [logs] if isinstance(logs, Log) else list(logs)
    truths = list(references) or [None] * len(logs)
    variants = tuple(Variant((name,), config) for name, config in configs.items())
    return Comparison((NAME,), variants, compare(logs, truths, list(configs.values()), runs, jobs, seed))
