"""The tables that people compare: evaluations as rows of strings, each under the headings that stand here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from pipeline.evaluate.aftermath import Row, aftermath_row
from pipeline.evaluate.metrics import Summary, wilson_interval
from pipeline.evaluate.report import Evaluation, LogEvaluation

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
    "log (s)",
    "wall (s)",
    "speed",
)
"""Headings of ``table``: medians, but for p95 and RMSE of what is to their left.

"right": scans localized, of all from the first one on; "after": of those since the robot was found. "log" and "wall":
seconds that the log lasts, and that a run takes on one thread; "speed": the one divided by the other.
"""
COMPARE_COLUMNS = ("log", "configuration", *COLUMNS[1:])
"""Headings of ``compare_table``."""
RECOVERY_COLUMNS = ("log", "kidnapped at (s)", "recovered", "after (s)", "p95")
"""Headings of ``recovery_table``."""
CHANGE_COLUMNS = ("log", "map", "asked (%)", "changed (%)", "least", "most")
"""Headings of ``change_table``: of the seen wall; changed: mean over runs."""
CERTAIN_COLUMNS = ("log", "certain", "after (s)", "p95")
"""Headings of ``certainty_table``."""
AGREEMENT_COLUMNS = (
    "log",
    "runs",
    "together (%)",
    "late",
    "explained (%)",
    "late",
    "stated (%)",
    "late",
    "found (%)",
    "late",
    "log (s)",
    "wall (s)",
)
"""Headings of ``agreement_table``: means over scans and runs, and over the scans in the second half of the log."""


def table(evaluation: Evaluation) -> list[Row]:
    """One row of strings per log whose truth is known, under COLUMNS."""
    return [_row(log) for log in evaluation.logs if log.scored]


def compare_table(evaluations: Sequence[tuple[str, Evaluation]]) -> list[Row]:
    """Log by log one row of strings per named evaluation, under COMPARE_COLUMNS."""
    names = dict.fromkeys(log.name for _, evaluation in evaluations for log in evaluation.logs)
    return [
        (name, label, *_row(log)[1:])
        for name in names
        for label, evaluation in evaluations
        for log in evaluation.logs
        if log.name == name and log.scored
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
    rows = []
    for log in evaluation.logs:
        certain = sum(run.score is not None and run.score.certain_at is not None for run in log.runs)
        after = _figures(log.over_runs(lambda score: score.certain_at), ".1f", "median", "p95")
        if log.scored:
            rows.append((log.name, f"{certain}/{len(log.runs)}", *after))
    return rows


def agreement_table(evaluation: Evaluation) -> list[Row]:
    """One row of strings per log whose truth is not known, under AGREEMENT_COLUMNS."""
    return [
        (
            log.name,
            f"{len(log.runs)}",
            *(
                "-" if share is None else f"{100 * share:.1f}"
                for all_scans, late in zip(asdict(told.all).values(), asdict(told.late).values(), strict=True)
                for share in (all_scans, late)
            ),
            f"{log.duration:.1f}",
            f"{log.wall:.1f}",
        )
        for log in evaluation.logs
        if not log.scored and (told := log.agreement) is not None
    ]


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
        f"{log.duration:.1f}",
        f"{log.wall:.1f}",
        f"{log.speed:.0f}",
    )


def _figures(summary: Summary | None, form: str, *names: str) -> Row:
    return tuple("-" if summary is None else format(getattr(summary, name), form).rstrip("%") for name in names)
