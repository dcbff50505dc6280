"""The beam model of a range finder (Probabilistic Robotics, Section 6.3 and Table 6.1)."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.config import Config
from pipeline.kernels import normal
from pipeline.maps.range_table import RangeCodes

Array = NDArray[np.float64]

MEASURED_BINS = 4096
"""Measured ranges are told apart to max_range / 4096: 2 cm for a laser that sees 82 m."""
NO_RETURN, INVALID = MEASURED_BINS, MEASURED_BINS + 1
"""The rows behind those of the ranges."""
TOGETHER = 64
"""Rows that are worked out at a time."""
LEAST = -100.0
"""Nats: no reading is less likely than that."""


def ndtr(x: Array) -> Array:
    """The share of a standard normal below each of ``x``."""
    out = np.empty(x.shape)
    normal.distribution(np.ascontiguousarray(x).reshape(-1), out.reshape(-1))
    return out


def mixture_density(z: ArrayLike, z_star: ArrayLike, config: Config, max_range: float) -> NDArray[np.float64]:
    """p(z | z*) per metre: hit, short, and random readings (Equations 6.4 to 6.12), and beyond the book
    readings that are too long, exponential from z* on; not for readings without return.

    ``z`` measured and ``z_star`` true ranges in metres, broadcast; z* = inf where the map ends no ray: then only short
    and random readings are possible. The weights are taken as they are; they need not add up to one.
    """
    z, z_star = np.broadcast_arrays(np.asarray(z, float), np.asarray(z_star, float))
    finite = np.isfinite(z_star)
    star = np.where(finite, z_star, max_range)
    sigma, rate = config.sigma_hit, config.lambda_short
    # The share of the Gaussian that lies within [0, max_range]: the book's normalizer of p_hit.
    inside = ndtr((max_range - star) / sigma) - ndtr(-star / sigma)
    gauss = np.exp(-0.5 * ((z - star) / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
    p_hit = np.where(finite, gauss / np.maximum(inside, 1e-9), 0.0)
    p_short = np.where(z <= star, rate * np.exp(-rate * z) / np.maximum(-np.expm1(-rate * star), 1e-9), 0.0)
    far = config.lambda_long
    beyond = np.maximum(-np.expm1(-far * (max_range - star)), 1e-9)
    p_long = np.where(finite & (z > star), far * np.exp(-far * np.maximum(z - star, 0.0)) / beyond, 0.0)
    p_rand = 1.0 / max_range
    return config.z_hit * p_hit + config.z_short * p_short + config.z_long * p_long + config.z_rand * p_rand


def is_hit(z: ArrayLike, z_star: ArrayLike, config: Config, max_range: float) -> NDArray[np.bool_]:
    """Whether the model takes a reading for a hit rather than for all else; arguments as ``mixture_density``."""
    all_else = config.model_copy(update={"z_hit": 0.0})
    density = mixture_density(z, z_star, config, max_range)
    return mixture_density(z, z_star, all_else, max_range) < 0.5 * density


def step_density(z: Array, low: Array, high: Array, config: Config, max_range: float) -> Array:
    """Mean of ``mixture_density`` over true ranges from ``low`` to ``high``: readings (n,) and steps (m,) -> (n, m).

    Where only the step of z* is known, a density at its middle would be too sure of itself: a hit at the step's end may
    be many sigmas away from there. Integrated exactly, but for the normalizers of hits and of long readings, which are
    taken at the middle. An infinite step is that of the rays that nothing ends.
    """
    z = z[:, None]
    finite = np.isfinite(high)
    density = np.full((len(z), len(high)), config.z_rand / max_range)
    # A ray that nothing ends may be cut short anywhere up to max_range.
    ends = mixture_density(z, np.inf, config.model_copy(update={"z_rand": 0.0}), max_range)
    density[:, ~finite] += ends
    low, high = low[finite], high[finite]
    width, middle, mean = high - low, (low + high) / 2, np.zeros((len(z), len(low)))
    if config.z_hit:
        sigma = config.sigma_hit
        inside = np.maximum(ndtr((max_range - middle) / sigma) - ndtr(-middle / sigma), 1e-9)
        # From the nearer tail, so that far away the difference of two tails is not one of two ones.
        tail_low, tail_high = ndtr(-np.abs(z - low) / sigma), ndtr(-np.abs(z - high) / sigma)
        within = (z >= low) & (z <= high)
        between = np.where(within, 1.0 - tail_low - tail_high, np.abs(tail_low - tail_high))
        mean += between * (config.z_hit / (inside * width))
    if config.z_short:
        rate = config.lambda_short
        # The integral of 1 / (1 - exp(-rate s)), over the part of the step that lies beyond z.
        with np.errstate(divide="ignore"):
            up_to = [s + np.log(-np.expm1(-rate * s)) / rate for s in (np.maximum(z, 1e-9), low, high)]
        beyond = np.maximum(up_to[2] - np.maximum(up_to[0], up_to[1]), 0.0)
        mean += beyond * (config.z_short * rate * np.exp(-rate * z) / width)
    if config.z_long:
        far = config.lambda_long
        inside = np.maximum(-np.expm1(-far * (max_range - middle)), 1e-9)
        passed = 1.0 - np.exp(-far * np.clip(z - low, 0.0, width))
        mean += np.exp(-far * np.maximum(z - high, 0.0)) * passed * (config.z_long / (inside * width))
    density[:, finite] += mean
    return density


def no_return_mass(z_star: ArrayLike, config: Config) -> NDArray[np.float64]:
    """Probability of a reading without return: z_max; where the map ends no ray, also z_hit and z_long."""
    z_star = np.asarray(z_star, float)
    return config.z_max + np.where(np.isfinite(z_star), 0.0, config.z_hit + config.z_long)


class BeamDensity(Protocol):
    """How probable a reading is, given the true range; arrays (n,) of readings, (m,) of steps of true ranges."""

    unexplained: float
    """Log-density of a beam from a pose in a wall, where it can have no true range."""

    def density(self, z: Array, expected: Array) -> Array:
        """Per metre, of readings and true ranges in metres of one shape; inf where the map ends no ray."""

    def over_steps(self, z: Array, low: Array, high: Array) -> Array:
        """(n, m) mean density over true ranges from ``low`` to ``high``, which are inf where the map ends no ray."""

    def no_return(self, expected: Array) -> Array:
        """(m,) probability of a reading without return."""

    def is_hit(self, z: Array, expected: Array) -> NDArray[np.bool_]:
        """Whether a reading saw the wall of the map rather than anything else."""


class Mixture:
    """The mixture of Table 6.1, as ``BeamDensity``."""

    def __init__(self, config: Config, max_range: float) -> None:
        self._asked = config, max_range
        # A pose inside a wall explains nothing: every beam is random (Table 6.1 with z_rand alone).
        self.unexplained = float(np.log(max(config.z_rand, 1e-6) / max_range))

    def density(self, z: Array, expected: Array) -> Array:
        """``mixture_density``."""
        return mixture_density(z, expected, *self._asked)

    def over_steps(self, z: Array, low: Array, high: Array) -> Array:
        """``step_density``."""
        return step_density(z, low, high, *self._asked)

    def no_return(self, expected: Array) -> Array:
        """``no_return_mass``."""
        return no_return_mass(expected, self._asked[0])

    def is_hit(self, z: Array, expected: Array) -> NDArray[np.bool_]:
        """``is_hit``."""
        return is_hit(z, expected, *self._asked)


class BeamModel:
    """log p(z | z*) for every pair of a measured range and a code of the true one, ready to be looked up."""

    def __init__(self, config: Config, codes: RangeCodes, max_range: float, density: BeamDensity | None = None) -> None:
        self._density = Mixture(config, max_range) if density is None else density
        self.config = config
        self.codes = codes
        self.max_range = max_range
        self.no_return = config.no_return_fraction * max_range
        self._log_likelihood = np.empty((MEASURED_BINS + 2, 256), np.float32)
        with np.errstate(divide="ignore"):
            self._log_likelihood[NO_RETURN] = np.maximum(np.log(self._density.no_return(codes.ranges)), LEAST)
        self._log_likelihood[INVALID] = 0.0  # says nothing about any pose
        self._known = np.zeros(MEASURED_BINS // TOGETHER + 1, bool)
        self._known[-1] = True

    def correct(self, ranges: NDArray[np.float32], bias: float) -> NDArray[np.float32]:
        """Ranges as the model sees them: the bias taken off, beyond the threshold 'no return' (inf), NaN kept."""
        seen = np.maximum(ranges - np.float32(bias), np.float32(0.0))
        return np.where(ranges >= self.no_return, np.float32(np.inf), seen).astype(np.float32)

    def scan_rows(self, corrected: NDArray[np.float32]) -> NDArray[np.float32]:
        """(k, 256) float32: the log-likelihood of each beam of a scan for every code of z*."""
        valid = np.isfinite(corrected)
        bins = np.where(valid, corrected, 0.0) * (MEASURED_BINS / self.max_range)
        index = np.minimum(bins.astype(np.int64), MEASURED_BINS - 1)
        index[np.isinf(corrected)] = NO_RETURN
        index[np.isnan(corrected)] = INVALID
        if not self._known[index // TOGETHER].all():
            self._work_out(np.unique(index // TOGETHER))
        return self._log_likelihood[index]

    def _work_out(self, wanted: NDArray[np.int64]) -> None:
        """Fill in the rows of these groups of measured ranges, where they are missing: a log needs few of them."""
        for group in wanted[~self._known[wanted]]:
            rows = np.arange(TOGETHER * group, TOGETHER * (group + 1))
            centres = (rows + 0.5) * self.max_range / MEASURED_BINS
            with np.errstate(divide="ignore"):
                density = np.log(self._density.over_steps(centres, *self.codes.steps))
            self._log_likelihood[rows] = np.maximum(density, LEAST)
            self._known[group] = True

    def temper(self, corrected: NDArray[np.float32]) -> float:
        """Exponent on the likelihood of a scan: it may count as ``independent_beams`` beams, and no more."""
        valid = int(np.count_nonzero(~np.isnan(corrected)))
        if self.config.independent_beams is None or valid == 0:
            return 1.0
        return min(1.0, self.config.independent_beams / valid)

    def outside(self, corrected: NDArray[np.float32]) -> float:
        """Log-likelihood of a pose in a wall or off the map: every valid beam is unexplained."""
        return self._density.unexplained * int(np.count_nonzero(~np.isnan(corrected)))
