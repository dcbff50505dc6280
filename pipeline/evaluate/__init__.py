"""Monte Carlo runs over seeds, scored against a reference trajectory."""

from pipeline.evaluate.aftermath import FAULT_COLUMNS
from pipeline.evaluate.agreement import Agreement
from pipeline.evaluate.calibration import (
    REGION_COLUMNS,
    RELIABILITY_COLUMNS,
    SCORE_COLUMNS,
    Calibration,
    calibration,
    region_table,
    reliability_table,
    score_table,
)
from pipeline.evaluate.calibration_plot import plot_calibration
from pipeline.evaluate.changes_plot import plot_changes
from pipeline.evaluate.failures import ANY, ENOUGH
from pipeline.evaluate.perturbed import Change, parse_changes, perturb
from pipeline.evaluate.plots import plot
from pipeline.evaluate.recovery_plot import plot_recovery
from pipeline.evaluate.report import Evaluation, LogEvaluation, Run
from pipeline.evaluate.runs import compare, evaluate
from pipeline.evaluate.table_file import check_table, write_table
from pipeline.evaluate.tables import (
    AGREEMENT_COLUMNS,
    CERTAIN_COLUMNS,
    CHANGE_COLUMNS,
    COLUMNS,
    COMPARE_COLUMNS,
    RECOVERY_COLUMNS,
    agreement_table,
    certainty_table,
    change_table,
    compare_table,
    fault_table,
    recovery_table,
    table,
)
from pipeline.evaluate.variants import Comparison, Variant, variants, with_changes, with_failures

__all__ = [
    "AGREEMENT_COLUMNS",
    "ANY",
    "CERTAIN_COLUMNS",
    "CHANGE_COLUMNS",
    "COLUMNS",
    "COMPARE_COLUMNS",
    "ENOUGH",
    "FAULT_COLUMNS",
    "RECOVERY_COLUMNS",
    "REGION_COLUMNS",
    "RELIABILITY_COLUMNS",
    "SCORE_COLUMNS",
    "Agreement",
    "Calibration",
    "Change",
    "Comparison",
    "Evaluation",
    "LogEvaluation",
    "Run",
    "Variant",
    "agreement_table",
    "calibration",
    "certainty_table",
    "change_table",
    "check_table",
    "compare",
    "compare_table",
    "evaluate",
    "fault_table",
    "parse_changes",
    "perturb",
    "plot",
    "plot_calibration",
    "plot_changes",
    "plot_recovery",
    "recovery_table",
    "region_table",
    "reliability_table",
    "score_table",
    "table",
    "variants",
    "with_changes",
    "with_failures",
    "write_table",
]
