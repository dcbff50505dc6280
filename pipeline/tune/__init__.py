"""Learns the sensor model, the noise of wheels and laser odometry, and the temper from logs, without ground truth."""

from pipeline.tune.histograms import plane, residuals
from pipeline.tune.learning import Tuning, tune
from pipeline.tune.plots import plot
from pipeline.tune.preset import COLUMNS, number, origin, preset, table
from pipeline.tune.reasons import Reason

__all__ = ["COLUMNS", "Reason", "Tuning", "number", "origin", "plane", "plot", "preset", "residuals", "table", "tune"]
