"""A beam model of the user's own, learned from readings: its numbers by maximum likelihood."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.filter.own_sensor import is_density
from pipeline.tune.em import Array, Fit, Readings

MOST_SCANS = 200
"""Of each log: a model of a few numbers needs no more, and may be slow."""
PER_PARAMETER = 60
"""Steps of the search (Nelder and Mead, 1965) for each number."""
OF_SENSOR = "sensor_model."


def learnable(config: Config) -> list[str]:
    """Parameters of the user's own beam model that can be learned: those that are numbers with a fraction."""
    if not is_density(config):
        return []
    return [key for key, value in config.own.items() if key.startswith(OF_SENSOR) and isinstance(value, float)]


def fit_own_model(readings: Sequence[Readings], config: Config) -> Fit:
    """Learn the numbers of the model from the readings, starting at ``config`` with its range_bias given.

    A number that starts above zero stays above zero, and values that the part itself forbids are not tried. Raises
    MclError if the part fails at the start.
    """
    from scipy.optimize import minimize

    names = learnable(config)
    few = [r.take(np.arange(0, len(r.measured), max(1, -(-len(r.measured) // MOST_SCANS)))) for r in readings]
    count = sum(int(np.count_nonzero(~np.isnan(r.measured))) for r in few)

    def mean(tried: Config) -> float:
        return sum(float(r.log_likelihood(tried).sum()) for r in few) / max(count, 1)

    history = [mean(config)]
    start = np.array([config.own[name] for name in names], np.float64)
    positive = start > 0.0
    if not names:
        return Fit(config, tuple(history))

    def at(x: Array) -> Config:
        values = np.where(positive, np.exp(np.where(positive, x, 0.0)), x)
        return config.model_copy(update={"own": config.own | dict(zip(names, values.tolist(), strict=True))})

    def loss(x: Array) -> float:
        try:
            value = mean(at(x))
        except MclError:
            return math.inf  # beyond what the part takes: at the start it took everything
        history.append(max(history[-1], value))
        return -value

    first = np.where(positive, np.log(np.where(positive, start, 1.0)), start)
    steps = np.where(positive, 0.3, np.maximum(0.3 * np.abs(start), 0.1))
    simplex = np.vstack([first, first + np.diag(steps)])
    options: Any = {"initial_simplex": simplex, "maxfev": PER_PARAMETER * len(names), "xatol": 1e-3, "fatol": 1e-5}
    found = minimize(loss, first, method="Nelder-Mead", options=options)
    return Fit(at(found.x), tuple(history))
