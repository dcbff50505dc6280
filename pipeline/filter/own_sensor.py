"""Sensor models of a user's own: p(z | z*), of which a table is made, or the likelihood of a scan at every particle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.filter.beam_model import LEAST, BeamDensity, Mixture
from pipeline.logs.messages import Laser
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.parts.own import Own
from pipeline.world.expected_ranges import ExpectedRanges

Array = NDArray[np.float64]

WITHIN_STEP = 5
"""Places within a step of true ranges at which a density is asked for the mean over it."""
ALONG = 256
"""Readings over which a density is integrated, to know what it leaves for readings without return."""
LEAST_MASS = 0.01
"""A reading without return is never less probable: a density that forgets them would exclude every place outdoors."""
HIT_WITHIN = 0.3
"""m: of a model of a user's own a reading counts as a hit if it is so near the true range."""


class OwnDensity:
    """p(z | z*) by a function of the user's own, as ``BeamDensity`` has it.

    What its ``no_return(expected)`` does not say, if it has none, is what the density leaves of the probability.
    """

    def __init__(self, own: Own, max_range: float) -> None:
        self._own, self._max_range = own, max_range
        z = (np.arange(ALONG) + 0.5) * max_range / ALONG
        least = float(self.density(*np.meshgrid(z, z, indexing="ij")).min())
        self.unexplained = max(float(np.log(least)) if least > 0.0 else LEAST, LEAST)

    def density(self, z: Array, expected: Array) -> Array:
        """As ``BeamDensity`` has it. Raises MclError for what is no density."""
        found = self._own.array(self._own(z.copy(), expected.copy()), z.shape, "densities")
        if (found < 0.0).any():
            at = np.unravel_index(int(np.argmin(found)), found.shape)
            said = (
                f"it gave the density {found[at]:g}, of a reading of {z[at]:g} m where {expected[at]:g} m are expected"
            )
            raise self._own.wrong(said)
        return found

    def over_steps(self, z: Array, low: Array, high: Array) -> Array:
        """As ``BeamDensity`` has it; the mean of a few places in each step."""
        mean = np.zeros((len(z), len(low)))
        for part in (np.arange(WITHIN_STEP) + 0.5) / WITHIN_STEP:
            with np.errstate(invalid="ignore"):
                at = np.where(np.isfinite(high), low + part * (high - low), np.inf)
            mean += self.density(*np.broadcast_arrays(z[:, None], at)) / WITHIN_STEP
        return mean

    def no_return(self, expected: Array) -> Array:
        """As ``BeamDensity`` has it."""
        expected = np.asarray(expected, np.float64)
        if (said := self._own.other("no_return")) is not None:
            told = np.broadcast_to(said(expected.copy()), expected.shape)
            mass = self._own.array(told, expected.shape, "probabilities")
        else:
            z = (np.arange(ALONG) + 0.5) * self._max_range / ALONG
            whole = self.density(*np.broadcast_arrays(z[:, None], expected)).sum(axis=0) * self._max_range / ALONG
            mass = 1.0 - whole
        return np.maximum(mass, LEAST_MASS)

    def is_hit(self, z: Array, expected: Array) -> NDArray[np.bool_]:
        """As ``BeamDensity`` has it."""
        return np.abs(z - expected) < HIT_WITHIN


class OwnLikelihood:
    """log p(scan | pose, map) by a function of the user's own, asked once a scan for all particles."""

    def __init__(self, own: Own, grid: OccupancyGrid, config: Config, expected: ExpectedRanges, angles: Array) -> None:
        self._own, self._grid, self._config = own, grid, config
        self._expected, self._angles = expected, angles

    def read(self, ranges: NDArray[np.float32]) -> NDArray[np.float32]:
        """(1, k) the scan as the model is asked for it."""
        return ranges[None]

    def temper(self, beams: int) -> float:
        """Exponent on the likelihood: the scan may count as ``independent_beams`` beams, and no more."""
        independent = self._config.independent_beams
        return 1.0 if independent is None or beams == 0 else min(1.0, independent / beams)

    def voices(self, beams: int) -> int:
        """How many factors the likelihood of so many beams has."""
        return max(1, beams)

    def score(self, poses: NDArray[np.float32], seen: NDArray[np.float32], out: NDArray[np.float32]) -> None:
        """Log-likelihood, untempered, at poses (3, n) float32 of the grid frame -> ``out`` (n,) float32.

        Poses at which the model gives no number are as improbable as can be.
        """
        rows = poses.T.astype(np.float64)
        offered: dict[str, NDArray[np.float32] | Array] = {"angles": self._angles}
        if self._own.asks_for("expected"):
            codes, blind = self._expected.codes_at(rows)
            expected = self._expected.codes.ranges[codes].astype(np.float32)
            expected[blind] = np.nan
            offered["expected"] = expected
        answer = np.asarray(self._own(self._grid.to_map(rows).T, seen[0].copy(), **offered), np.float64)
        if answer.shape != out.shape:
            raise self._own.wrong(f"it gave an array of {answer.shape}, expected log-likelihoods, {out.shape}")
        least = LEAST * seen.shape[1]
        out[:] = np.maximum(np.nan_to_num(answer, nan=least, posinf=least, neginf=least), least)


def beam_density(
    config: Config, max_range: float, grid: OccupancyGrid | None = None, laser: Laser | None = None
) -> BeamDensity:
    """The beam model that ``config.sensor_model`` names; the built-in one if it names no beam model.

    ``grid`` and ``laser``: for a model of the user's own that asks for them.
    """
    if not is_density(config):
        return Mixture(config, max_range)
    known = {name: value for name, value in (("grid", grid), ("laser", laser)) if value is not None}
    own = config.own_part("sensor_model", max_range=max_range, **known)
    assert own is not None, "a density is a part of the user's own"
    return OwnDensity(own, max_range)


def is_density(config: Config) -> bool:
    """Whether ``config.sensor_model`` is a beam model of the user's own."""
    found = config.written("sensor_model")
    return found is not None and found[0].method.name == "density"
