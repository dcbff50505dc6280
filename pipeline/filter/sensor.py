"""The laser as the filter knows it: which beams it uses, and how likely they are anywhere on the map."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.filter.beam_model import BeamModel, Mixture
from pipeline.filter.own_sensor import OwnLikelihood, beam_density, is_density
from pipeline.filter.range_bias import RangeBias
from pipeline.filter.search import Posterior, Search
from pipeline.filter.step import Beams
from pipeline.geometry import compose
from pipeline.logs.messages import Laser
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.maps.walls import wall_half_thickness
from pipeline.parts.loading import built_in
from pipeline.parts.roles import ROLES
from pipeline.world.agnostic import Agnostic
from pipeline.world.expected_ranges import ExpectedRanges, select_beams
from pipeline.world.unknown import PRICE, Unknown
from pipeline.world.world import World

EXPLAINED_WITHIN = 0.3
"""Metres: a beam is explained if it ends so close to where the map says it must."""
SHOWN = 0.7
"""Probability that the world is as the log has shown it, where the map has it otherwise."""
ANYTHING = 0.1
"""Share of the beams, in a contest of places, that may be anything that this laser reads: then no place loses by much
where the map is poor. With 0 a robot off the map was taken elsewhere in two of six drives."""
HOTTEST = 8000
"""Cells that a search is remembered by."""


@dataclass(frozen=True)
class Reading:
    """A scan as the sensor model sees it: ``ranges`` (k,) float32 m, corrected; ``rows`` (k, 256) float32, their
    log-likelihood for every code of the true range; ``outside``: log-likelihood of a pose in a wall; ``seen`` (.., m)
    float32, what another sensor model than a beam model needs of the scan; ``temper``: the exponent that lets
    the scan count as ``independent_beams`` beams; ``valid``: number of factors in its likelihood, one a beam."""

    ranges: NDArray[np.float32]
    rows: NDArray[np.float32]
    outside: float
    temper: float
    valid: int
    agnostic: NDArray[np.float64]
    seen: NDArray[np.float32] | None = None

    @cached_property
    def likelihood(self) -> NDArray[np.float32]:
        """(k, 256) what ``rows`` are the logarithms of."""
        return np.exp(self.rows)


class ScanModel(Protocol):
    """A sensor model that is no beam model: it weighs particles by whatever it reads of the scan."""

    def read(self, ranges: NDArray[np.float32]) -> NDArray[np.float32]:
        """(.., m) float32: what it needs of a scan's chosen beams (k,), m of them."""

    def temper(self, beams: int) -> float:
        """Exponent on the likelihood of so many beams."""

    def voices(self, beams: int) -> int:
        """How many factors the likelihood of so many beams has, at least one."""

    def score(self, poses: NDArray[np.float32], seen: NDArray[np.float32], out: NDArray[np.float32]) -> None:
        """Log-likelihood, untempered, at poses (3, n) float32 of the grid frame -> ``out`` (n,) float32."""


class Sensor:
    """Beams in, likelihoods out, by the model that ``config.sensor_model`` names.

    A beam model is there whichever that is: a search of the building uses its table of ranges. So with a likelihood
    field a search only proposes places, by the beam model's own parameters, and the field weighs them.
    """

    def __init__(self, grid: OccupancyGrid, laser: Laser, config: Config) -> None:
        self._grid, self._laser, self._config = grid, laser, config
        self._beams = select_beams(laser, config)
        max_range = config.laser_max_range or laser.range_max
        half_thickness = wall_half_thickness(grid, grid.wall_threshold(config.occupied_threshold))
        self._expected = ExpectedRanges(grid, laser, self._beams, config, max_range, half_thickness)
        density = beam_density(config, max_range, grid, laser)
        self._model = BeamModel(config, self._expected.codes, max_range, density)
        self._other = self._instead(max_range)
        searches = config.init == "exhaustive" or config.recovery == "search"
        self._search = Search(grid, laser, self._expected, config.free_threshold) if searches else None
        self._searched: Posterior | None = None
        self.bias = RangeBias(config, half_thickness)
        self._agnostic = Agnostic(max_range)
        weights = config.z_hit + config.z_short + config.z_max + config.z_rand + config.z_long
        self._measure = 1.0 if math.isclose(weights, 1.0) or not isinstance(density, Mixture) else weights
        self._unknown: Unknown | None = None
        self.world: World | None = None
        if self._other is None and self._expected.table is not None and "off_map" not in config.without:
            width = self._expected.rows.shape[1]
            self.world = World(grid, grid.wall_threshold(config.occupied_threshold), self._expected.codes, width)
            self._unknown = Unknown(self.world, self._expected, self._agnostic)

    def _instead(self, max_range: float) -> ScanModel | None:
        """What weighs the particles, if it is not a beam model."""
        config, grid, laser, angles = self._config, self._grid, self._laser, self._laser.angles[self._beams]
        if is_density(config):
            return None
        own = config.own_part("sensor_model", max_range=max_range, grid=grid, laser=laser)
        if own is not None:
            return OwnLikelihood(own, grid, config, self._expected, angles)
        kind = built_in(ROLES["sensor_model"], config.sensor_model)
        return None if kind is Mixture else kind(grid, laser, angles, config, max_range)

    def read(self, scan: NDArray[np.float32]) -> Reading:
        """Of a scan (beams,) the chosen beams, and their likelihood for every true range."""
        self._searched = None
        ranges = self._model.correct(scan[self._beams], self.bias.value)
        rows, outside = self._model.scan_rows(ranges), self._model.outside(ranges)
        self._agnostic.learn(ranges)
        # In the model's own measure: its weights need not add up to one.
        agnostic = self._agnostic.density(ranges) * self._measure
        if self._other is not None:
            seen = self._other.read(ranges)
            m = seen.shape[1]
            return Reading(ranges, rows, outside, self._other.temper(m), self._other.voices(m), agnostic, seen)
        valid = int(np.count_nonzero(~np.isnan(ranges)))
        return Reading(ranges, rows, outside, self._model.temper(ranges), max(1, valid), agnostic)

    def score(
        self,
        poses: NDArray[np.float32],
        reading: Reading,
        out: NDArray[np.float32],
        before: NDArray[np.float32] | None = None,
    ) -> None:
        """Log-likelihood, untempered, at poses (3, n) float32 of the grid frame -> ``out`` (n,) float32.

        ``before`` (3, n): where each pose came from; without it none may be off the map.
        """
        if self._other is not None:
            assert reading.seen is not None, "a reading of another sensor"
            self._other.score(poses, reading.seen, out)
            return
        self._expected.score(poses, reading.rows, reading.outside, out)
        if before is None or self._unknown is None or np.isnan(reading.ranges).all():
            return
        if (off := self._unknown.find(poses)) is None:
            return
        score = self._unknown.beams(off, reading.ranges, reading.agnostic, reading.likelihood).sum(axis=1)
        entered, walled = self._unknown.entered(off, before, poses)
        score[entered] -= PRICE / reading.temper
        score[walled] = reading.outside
        out[off.which] = score

    def off_map(self, poses: NDArray[np.float32], weights: NDArray[np.float64]) -> float:
        """How much of the weights (n,) poses (3, n) of the grid frame have that stand on land unknown to the map."""
        off = None if self._unknown is None else self._unknown.find(poses)
        return 0.0 if off is None else float(weights[off.which].sum())

    @property
    def searches(self) -> bool:
        """Whether the building can be searched, for which the table of ranges is needed."""
        return self._search is not None

    def search_near(self, reading: Reading, before: NDArray[np.float64], n: int, key: np.uint64) -> Posterior:
        """n poses drawn from what this scan says of the places that were probable ``before`` (height, width) it."""
        assert self._search is not None, "neither init nor recovery asks for a search"
        return self._search(reading.rows, self._config.independent_beams, n, key, coarse=True, before=before)

    def search(self, reading: Reading, n: int, key: np.uint64, coarse: bool = False) -> Posterior:
        """n poses drawn from what this scan alone says of the whole building, by the beam model; ``coarse``: asking
        every 0.2 m only, which is enough to know where to look."""
        assert self._search is not None, "neither init nor recovery asks for a search"
        self._searched = self._search(reading.rows, self._config.independent_beams, n, key, coarse)
        return self._searched

    def heat(self) -> NDArray[np.float32] | None:
        """(m, 3) x, y (m, map frame) of the best cells of the search made for the scan just read, with their nats
        behind the best; None if there was none."""
        if self._searched is None:
            return None
        order = np.argsort(-self._searched.best, kind="stable")[:HOTTEST]
        cells, best = self._searched.cells[order], self._searched.best[order]
        row, col = np.divmod(cells, self._grid.width)
        centre = np.stack([(col + 0.5), (row + 0.5), np.zeros(len(cells))], axis=-1) * self._grid.resolution
        heat = self._grid.to_map(centre)
        heat[:, 2] = best - best[0]
        return heat.astype(np.float32)

    def statement(
        self, poses: NDArray[np.float64], reading: Reading, roams: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], float]:
        """(n, k) log-likelihood of each beam at poses (n, 3) of the grid frame, by the beam model; and for how many
        independent beams one counts. ``roams`` (n,): which of them may be off the map."""
        codes, outside = self._expected.codes_at(poses)
        beams = reading.rows[np.arange(codes.shape[1]), codes].astype(np.float64)
        beams[outside] = self._model.outside(reading.ranges) / codes.shape[1]
        if self._unknown is not None:
            if self.world is not None and self.world.version:
                near, by_log = self._unknown.by_log(_columns(poses))
                beams[near] = self._either(beams[near], codes[near], by_log, reading)
            rows = np.flatnonzero(roams)
            if (off := self._unknown.find(_columns(poses[rows]))) is not None:
                beams[rows[off.which]] = self._unknown.beams(off, reading.ranges, reading.agnostic, reading.likelihood)
        beams = np.logaddexp(math.log(1.0 - ANYTHING) + beams, math.log(ANYTHING) + np.log(reading.agnostic))
        return beams, self._model.temper(reading.ranges)

    def _either(
        self, beams: NDArray[np.float64], by_map: NDArray[np.uint8], by_log: NDArray[np.uint8], reading: Reading
    ) -> NDArray[np.float64]:
        """Log-likelihood (n, k) of beams that see the mapped world or the one that the log has shown, where the two
        differ: ``beams`` by the map, for the codes ``by_map``, of which those in the other are ``by_log``."""
        differ = by_map != by_log
        shown = reading.rows[np.arange(by_log.shape[1]), by_log].astype(np.float64)
        mixed = np.logaddexp(math.log(1.0 - SHOWN) + beams, math.log(SHOWN) + shown)
        return np.where(differ, mixed, beams)

    def ends(self, pose: NDArray[np.float64], reading: Reading) -> NDArray[np.float64]:
        """(k, 2) where the beams ended, seen from a pose (3,) of the robot, in its frame; not finite for no return."""
        x, y, yaw = compose(pose, self._laser.pose)
        angles, ranges = yaw + self._laser.angles[self._beams], reading.ranges.astype(np.float64)
        ranges[~np.isfinite(ranges)] = np.nan
        return np.stack([x + ranges * np.cos(angles), y + ranges * np.sin(angles)], axis=1)

    def beams_at(self, pose: NDArray[np.float64], reading: Reading) -> Beams:
        """The beams as they should be and as they are, at a pose (3,) of the robot in the map frame."""
        at = self._grid.to_grid(pose)
        codes, outside = self._expected.codes_at(at[None])
        expected = self._expected.codes.ranges[codes[0]].astype(np.float32)
        said = reading.rows[np.arange(codes.shape[1]), codes[0]]
        if outside[0]:
            said = np.full(len(said), self._model.outside(reading.ranges) / len(said))
        if self._unknown is not None and (off := self._unknown.find(_columns(at[None]))) is not None:
            wall, known = self._unknown.ranges(off)
            ended = ~(reading.ranges >= known[0])
            expected = np.where(ended, np.nan, wall[0]).astype(np.float32)
            said = self._unknown.beams(off, reading.ranges, reading.agnostic, reading.likelihood)[0]
        told = ~np.isnan(reading.ranges)
        worth = float(np.mean((said - np.log(reading.agnostic))[told])) if told.any() else 0.0
        angles = self._laser.angles[self._beams]
        return Beams(compose(pose, self._laser.pose), angles, reading.ranges, expected, worth)


def _columns(poses: NDArray[np.float64]) -> NDArray[np.float32]:
    """Poses (n, 3) as the kernels take them: (3, n)."""
    return np.ascontiguousarray(poses.T.astype(np.float32))


def explained_share(beams: Beams) -> float:
    """Share of the beams with a return that end within 0.3 m of where the map says they must; 0 without any."""
    counted = np.isfinite(beams.measured) & ~np.isnan(beams.expected)
    if not np.any(counted):
        return 0.0
    return float(np.mean(np.abs(beams.measured[counted] - beams.expected[counted]) < EXPLAINED_WITHIN))


def contradicting_shares(beams: Beams) -> tuple[float, float]:
    """Shares of the beams with a return that end more than 0.3 m before what is mapped; and that end more than 0.6 m
    behind it, with a neighbour that does so, too: a single one may have passed by an edge."""
    counted = np.isfinite(beams.measured) & ~np.isnan(beams.expected)
    if not np.any(counted):
        return 0.0, 0.0
    beyond = np.where(counted, beams.measured, 0.0) - np.where(counted, beams.expected, 0.0)
    behind = counted & (beyond > 2.0 * EXPLAINED_WITHIN)
    beside = np.zeros_like(behind)
    beside[1:] |= behind[:-1]
    beside[:-1] |= behind[1:]
    n = np.count_nonzero(counted)
    short = np.count_nonzero(counted & (beyond < -EXPLAINED_WITHIN)) / n
    return float(short), float(np.count_nonzero(behind & beside) / n)
