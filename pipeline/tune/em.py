"""The beam model, learned from readings by Expectation-Maximization (Probabilistic Robotics, Table 6.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.filter.own_sensor import beam_density

Array = NDArray[np.float64]

PARTS = ("z_hit", "z_short", "z_long", "z_rand", "z_max")
"""The causes that a reading may have; their weights add up to one."""
LEARNED = (*PARTS, "sigma_hit", "lambda_short", "lambda_long", "range_bias")
ITERATIONS = 100
TOLERANCE = 1e-5
"""Nats per reading: an iteration that gains less is the last."""
FLOOR = 0.002
"""What no log shows may still happen: no cause starts or ends with less weight."""
SIGMA, RATE = (0.01, 3.0), (0.01, 20.0)
"""Bounds of the deviation, m, and of the rates, 1/m: beyond them the data do not tell one cause from another."""


@dataclass(frozen=True)
class Readings:
    """What a laser measured and what it should have: ``measured`` and ``expected`` (scans, beams) m, of one log.

    ``measured`` as it came, with its bias: NaN = invalid, inf = no return. ``expected``: true ranges z*, inf = none.
    """

    measured: Array
    expected: Array
    max_range: float

    def take(self, scans: NDArray[np.bool_] | NDArray[np.int64]) -> Readings:
        """Only these scans."""
        return Readings(self.measured[scans], self.expected[scans], self.max_range)

    def seen(self, bias: float) -> Array:
        """(scans, beams) measured ranges as the model sees them: the bias taken off."""
        return np.maximum(self.measured - bias, 0.0)

    def residuals(self) -> Array:
        """(m,) measured less true range, m, with its bias, of beams that have both."""
        both = np.isfinite(self.measured) & np.isfinite(self.expected)
        return self.measured[both] - self.expected[both]

    def log_likelihood(self, config: Config) -> Array:
        """(scans, beams) log p(z | z*) under a configuration whose range_bias is given; 0 for invalid readings."""
        valid = ~np.isnan(self.measured)
        out = np.zeros(self.measured.shape)
        out[valid] = _log(_likelihood(_flat([self]), config))
        return out


@dataclass(frozen=True)
class Fit:
    """The learned configuration, and mean log-likelihood per reading before each iteration and at the end, nats."""

    config: Config
    history: tuple[float, ...]


def fit_beam_model(readings: Sequence[Readings], config: Config) -> Fit:
    """Learn LEARNED from the readings, starting at ``config`` with its range_bias given (Table 6.2, and two more).

    Every step raises the likelihood or leaves it: the weights in closed form; sigma and the rates by a search in one
    dimension over the expected log-likelihood *with* the normalizers of the truncated densities, for which the
    book's closed forms are only right far from the ends; the bias by the mean residual of the hits, where that helps.
    """
    flat = _flat(readings)
    config = _with_weights(config, np.array([getattr(config, name) for name in PARTS]))
    history: list[float] = []
    for _ in range(ITERATIONS):
        weighted = _weighted(flat, config)
        total = weighted.sum(axis=0)
        history.append(float(_log(total).mean()))
        if len(history) > 1 and history[-1] - history[-2] < TOLERANCE:
            break
        config = _maximize(flat, weighted / np.maximum(total, 1e-300), config)
    return Fit(_with_weights(config, np.array([getattr(config, name) for name in PARTS])), tuple(history))


@dataclass(frozen=True)
class _Flat:
    """Valid readings of all logs, (m,) each: raw range, true range, the laser's maximum."""

    z: Array
    star: Array
    log: NDArray[np.int64]
    max_ranges: tuple[float, ...]

    def far(self) -> Array:
        return np.array(self.max_ranges)[self.log]

    def seen(self, bias: float) -> Array:
        return np.maximum(self.z - bias, 0.0)


def _flat(readings: Sequence[Readings]) -> _Flat:
    valid = [~np.isnan(r.measured) for r in readings]
    return _Flat(
        np.concatenate([r.measured[v] for r, v in zip(readings, valid, strict=True)]),
        np.concatenate([r.expected[v] for r, v in zip(readings, valid, strict=True)]),
        np.concatenate([np.full(int(v.sum()), i) for i, v in enumerate(valid)]),
        tuple(r.max_range for r in readings),
    )


def _likelihood(flat: _Flat, config: Config) -> Array:
    """(m,) per metre, or a mass where nothing returned."""
    assert config.range_bias is not None
    seen, missing = flat.seen(config.range_bias), np.isinf(flat.z)
    out = np.zeros(len(missing))
    for i, far in enumerate(flat.max_ranges):
        model, of_log = beam_density(config, far), flat.log == i
        out[of_log & missing] = model.no_return(flat.star[of_log & missing])
        at = of_log & ~missing
        out[at] = model.density(seen[at], flat.star[at])
    return out


def _weighted(flat: _Flat, config: Config) -> Array:
    """(parts, m) likelihood of each reading by each cause: the filter's own mixture with one weight at a time."""
    nothing = dict.fromkeys(PARTS, 0.0)
    return np.stack(
        [_likelihood(flat, config.model_copy(update={**nothing, name: getattr(config, name)})) for name in PARTS]
    )


def _maximize(flat: _Flat, share: Array, config: Config) -> Config:
    """The M-step: ``share`` (parts, m) says how far each cause is responsible for each reading."""
    assert config.range_bias is not None
    weights = dict(zip(PARTS, share.mean(axis=1).tolist(), strict=True))
    seen, both = flat.seen(config.range_bias), np.isfinite(flat.z) & np.isfinite(flat.star)
    hit, short, long = share[0] * both, share[1] * np.isfinite(flat.z), share[2] * both
    star, far = np.where(np.isfinite(flat.star), flat.star, flat.far()), flat.far()
    learned = config.model_copy(
        update={
            **weights,
            "sigma_hit": _sigma(config.sigma_hit, hit, seen, star, far),
            "lambda_short": _rate(config.lambda_short, short, seen, star),
            "lambda_long": _rate(config.lambda_long, long, seen - star, far - star),
        }
    )
    return _shifted(flat, learned, hit, seen - star)


def _sigma(now: float, share: Array, seen: Array, star: Array, far: Array) -> float:
    """Of a Gaussian cut off at 0 and at the maximum range; far from both ends this is the book's closed form."""
    from scipy.special import ndtr

    used = share > 1e-9
    share, residual, star, far = share[used], (seen - star)[used], star[used], far[used]

    def expected(sigma: float) -> float:
        inside = np.maximum(ndtr((far - star) / sigma) - ndtr(-star / sigma), 1e-9)
        return float(share @ (-np.log(sigma * inside) - 0.5 * (residual / sigma) ** 2))

    return _search(expected, now, *SIGMA)


def _rate(now: float, share: Array, beyond: Array, length: Array) -> float:
    """Of an exponential over ``beyond`` >= 0 that is cut off at ``length``."""
    used = share > 1e-9
    share, beyond, length = share[used], beyond[used], length[used]

    def expected(rate: float) -> float:
        inside = np.maximum(-np.expm1(-rate * length), 1e-9)
        return float(share @ (np.log(rate / inside) - rate * beyond))

    return _search(expected, now, *RATE)


def _search(value: Callable[[float], float], now: float, low: float, high: float) -> float:
    """Where ``value`` is greatest between the bounds, on a logarithmic scale; ``now`` unless that is better."""
    from scipy.optimize import minimize_scalar

    found = minimize_scalar(lambda x: -value(np.exp(x)), bounds=(np.log(low), np.log(high)), method="bounded")
    best = float(np.exp(found.x))
    return best if value(best) > value(now) else now


def _shifted(flat: _Flat, config: Config, hit: Array, residual: Array) -> Config:
    """The bias moved by the hits' mean residual, or by part of it, if the readings are then more likely."""
    assert config.range_bias is not None
    before = _log(_likelihood(flat, config)).mean()
    step = float(hit[hit > 0.0] @ residual[hit > 0.0]) / max(float(hit.sum()), 1e-9)
    for part in (1.0, 0.3, 0.1):
        moved = config.model_copy(update={"range_bias": config.range_bias + part * step})
        if _log(_likelihood(flat, moved)).mean() > before:
            return moved
    return config


def _with_weights(config: Config, weights: Array) -> Config:
    weights = np.maximum(weights / weights.sum(), FLOOR)
    return config.model_copy(update=dict(zip(PARTS, (weights / weights.sum()).tolist(), strict=True)))


def _log(likelihood: Array) -> Array:
    return np.log(np.maximum(likelihood, 1e-43))  # the filter's own floor: -100 nats
