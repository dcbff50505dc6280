"""The table of an evaluation as a file: CSV, all figures in full, for programs; LaTeX, as it is printed, for papers."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from pipeline.errors import MclError
from pipeline.evaluate.aftermath import Row
from pipeline.evaluate.metrics import wilson_interval
from pipeline.evaluate.paired import Paired, paired_row
from pipeline.evaluate.tables import AGREEMENT_COLUMNS, COLUMNS, agreement_table, table

if TYPE_CHECKING:
    from pipeline.evaluate.report import LogEvaluation
    from pipeline.evaluate.variants import Comparison

TABLES: Final = (".csv", ".tex")
"""Suffixes that tell what to write."""
SUMMARIES: Final = (
    "time_to_localize",
    "position_error",
    "heading_error",
    "scans_right",
    "localized_after",
    "ate",
    "ate_after",
    "hindsight_ate",
)
"""What is in the CSV by median, p95 and rmse, under the names that JSON has."""
PAIRED: Final = ("only this", "only first", "p", "right (%)", "p", "error (m)", "p")
_SPECIAL = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": "$<$", ">": "$>$"}
_SPECIAL |= {character: f"\\{character}" for character in "&%$#_{}"}


def check_table(path: Path) -> None:
    """Raises MclError for a suffix that tells no format."""
    if path.suffix.lower() not in TABLES:
        raise MclError(f"a table is one of {', '.join(TABLES)}, told apart by its suffix", path=path)


def write_table(comparison: Comparison, path: Path) -> None:
    """Write one row per log and variant, each but the first variant with its paired tests against that one."""
    if path.suffix.lower() == ".csv":
        _write_csv(comparison, path)
    else:
        path.write_text(_latex(comparison), encoding="utf-8")


def _write_csv(comparison: Comparison, path: Path) -> None:
    rows = [_plain(comparison, k, log) for k in range(len(comparison.variants)) for log in _logs(comparison, k)]
    names = list(dict.fromkeys(name for row in rows for name in row))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, names, restval="")
        writer.writeheader()
        writer.writerows(rows)


def _plain(comparison: Comparison, variant: int, log: LogEvaluation) -> dict[str, Any]:
    """Metres, degrees, seconds, and shares from 0 to 1; what is not known is left empty."""
    named = dict(zip(comparison.keys, comparison.variants[variant].values, strict=True))
    row: dict[str, Any] = {"log": log.name, **named, "runs": len(log.runs)}
    if log.scored:
        low, high = wilson_interval(log.successes, len(log.runs))
        row |= {"successes": log.successes, "success_low": low, "success_high": high}
        told = log.to_dict()
        for name in SUMMARIES:
            row |= {f"{name}_{key}": value for key, value in (told[name] or {}).items()}
    if log.agreement is not None:
        for name, values in log.agreement.to_dict().items():
            row |= {f"{key}_{name}": value for key, value in values.items() if value is not None}
    row |= {"log_seconds": log.duration, "wall_seconds": log.wall, "speed": log.speed}
    if (tests := _paired(comparison, variant, log.name)) is not None:
        row |= {"only_this": tests.only_this, "only_first": tests.only_first, "p_success": tests.p_success}
        for name, difference in (("right", tests.right), ("error", tests.error)):
            row |= {f"{name}_difference": difference.median, f"p_{name}": difference.p}
    return row


def _latex(comparison: Comparison) -> str:
    """Tables as booktabs has them: of the logs whose truth is known, and of the others."""
    scored: list[tuple[int, Row]] = []
    unscored: list[tuple[int, Row]] = []
    for k, done in enumerate(comparison.evaluations):
        scored += [(k, row) for row in table(done)]
        unscored += [(k, row) for row in agreement_table(done)]
    varied = len(comparison.variants) > 1
    keys = (", ".join(comparison.keys),) if varied else ()
    parts = []
    if scored:
        rows = [_labelled(comparison, k, row, with_tests=varied) for k, row in scored]
        parts.append(_tabular((COLUMNS[0], *keys, *COLUMNS[1:], *(PAIRED if varied else ())), rows))
    if unscored:
        rows = [_labelled(comparison, k, row, with_tests=False) for k, row in unscored]
        parts.append(_tabular((AGREEMENT_COLUMNS[0], *keys, *AGREEMENT_COLUMNS[1:]), rows))
    return "% needs \\usepackage{booktabs}\n" + "\n".join(parts)


def _labelled(comparison: Comparison, variant: int, row: Row, *, with_tests: bool) -> Row:
    label = (comparison.variants[variant].label,) if len(comparison.variants) > 1 else ()
    tests = _paired(comparison, variant, row[0]) if with_tests else None
    last = ("",) * len(PAIRED) if tests is None else paired_row(tests)[2:]
    return (row[0], *label, *row[1:], *(last if with_tests else ()))


def _tabular(heading: Row, rows: list[Row]) -> str:
    lines = [" & ".join(map(_escaped, row)) + r" \\" for row in (heading, *rows)]
    columns = "l" * (len(heading) - len(rows[0]) + 1) + "r" * (len(rows[0]) - 1)
    begin, end = f"\\begin{{tabular}}{{{columns}}}", "\\end{tabular}"
    return "\n".join([begin, r"\toprule", lines[0], r"\midrule", *lines[1:], r"\bottomrule", end]) + "\n"


def _escaped(text: str) -> str:
    return "".join(_SPECIAL.get(character, character) for character in text)


def _logs(comparison: Comparison, variant: int) -> tuple[LogEvaluation, ...]:
    return comparison.evaluations[variant].logs


def _paired(comparison: Comparison, variant: int, log: str) -> Paired | None:
    label = comparison.variants[variant].label
    return next((each for each in comparison.paired if (each.log, each.variant) == (log, label)), None)
