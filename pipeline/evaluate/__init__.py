"""Monte Carlo runs over seeds, scored against a reference trajectory."""

from pipeline.evaluate.plots import plot
from pipeline.evaluate.report import (
    CERTAIN_COLUMNS,
    COLUMNS,
    COMPARE_COLUMNS,
    RECOVERY_COLUMNS,
    Evaluation,
    LogEvaluation,
    Run,
    certainty_table,
    compare_table,
    recovery_table,
    table,
)
from pipeline.evaluate.runs import compare, evaluate
from pipeline.evaluate.variants import Comparison, Variant, variants

__all__ = [
    "CERTAIN_COLUMNS",
    "COLUMNS",
    "COMPARE_COLUMNS",
    "RECOVERY_COLUMNS",
    "Comparison",
    "Evaluation",
    "LogEvaluation",
    "Run",
    "Variant",
    "certainty_table",
    "compare",
    "compare_table",
    "evaluate",
    "plot",
    "recovery_table",
    "table",
    "variants",
]
