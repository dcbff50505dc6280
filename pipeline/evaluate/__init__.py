"""Monte Carlo runs over seeds, scored against a reference trajectory."""

from pipeline.evaluate.aftermath import FAULT_COLUMNS
from pipeline.evaluate.failures import ANY, ENOUGH
from pipeline.evaluate.plots import plot
from pipeline.evaluate.recovery_plot import plot_recovery
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
    fault_table,
    recovery_table,
    table,
)
from pipeline.evaluate.runs import compare, evaluate
from pipeline.evaluate.variants import Comparison, Variant, variants, with_failures

__all__ = [
    "ANY",
    "CERTAIN_COLUMNS",
    "COLUMNS",
    "COMPARE_COLUMNS",
    "ENOUGH",
    "FAULT_COLUMNS",
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
    "fault_table",
    "plot",
    "plot_recovery",
    "recovery_table",
    "table",
    "variants",
    "with_failures",
]
