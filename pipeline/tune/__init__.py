"""Learns the sensor model, the noise of wheels and laser odometry, and the temper from logs, without ground truth."""

from pipeline.tune.histograms import plane, residuals
from pipeline.tune.learning import Tuning, tune
from pipeline.tune.plots import plot
from pipeline.tune.preset import COLUMNS, preset, table

__all__ = ["COLUMNS", "Tuning", "plane", "plot", "preset", "residuals", "table", "tune"]
