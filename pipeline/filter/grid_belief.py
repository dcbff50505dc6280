"""Grid localization (Probabilistic Robotics, Table 8.1): the probability of every cell, where it is not negligible."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.filter.estimate import Clusters
from pipeline.filter.lattice import NARROW, Cells, Lattice, together
from pipeline.filter.particles import Particles
from pipeline.filter.resampling import low_variance
from pipeline.filter.sensor import Reading, Sensor
from pipeline.filter.step import Estimate
from pipeline.geometry import wrap_angle
from pipeline.kernels.lattice import sum_of_products
from pipeline.kernels.random import stream_key
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.motion.prior import Prior

Array = NDArray[np.float64]

NEGLIGIBLE = 25.0
"""Nats behind the best cell from which on a cell is forgotten."""
MOST_CELLS = 30_000_000
"""Cells at the start, for which some 4 GB are needed."""
HERE = (0.5, math.radians(10.0))
"""m, rad: what lies as close to the estimate is the same place: as close as a pose must be to count as right."""
ANYWHERE = 0.5
"""Share of the belief that may be anywhere, where nobody saw the way and the wheels stood still."""
SHOW = 1
"""Purpose of random numbers."""


NO_CELLS = Cells(np.zeros(1, np.int64), np.empty(0, np.int32), np.empty(0, np.int32), np.empty(0))


class GridBelief:
    """What ``Belief`` is to particles: predict, weigh, group.

    ``particles``: one at the centre of each cell, or as many as there may be, drawn by weight; ``hypotheses`` and
    ``followed`` (components of the prior,) as those of ``Belief``, from all cells.
    """

    def __init__(self, grid: OccupancyGrid, config: Config, sensor: Sensor, seed: int) -> None:
        self._grid, self._config, self._sensor, self._seed = grid, config, sensor, seed
        self._lattice = Lattice.of(config.grid_d, config.grid_a)
        height, width = (math.ceil(cells * grid.resolution / config.grid_d) for cells in grid.occupancy.shape)
        self._plane = np.zeros((height, width))
        self._cells = NO_CELLS
        self._clusters = Clusters(grid, config.max_particles)
        self._room = config.max_particles
        self.particles = Particles(config.max_particles)
        self.hypotheses: tuple[Estimate, ...] = ()
        self.followed: Array = np.empty(0)

    def start(self, reading: Reading, scan: int) -> None:
        """Where ``config.init`` says, equally probable all over the free cells unless it names a pose; then weigh.

        Raises MclError if the map has no free cell, initial_pose is not on the map, or there are too many cells.
        """
        self._cells = self._around_pose() if self._config.init == "pose" else self._everywhere()
        self._weigh(reading, scan)

    def advance(self, prior: Prior, reading: Reading, scan: int, carried: bool = False) -> None:
        """Every cell moves as the prior says, and is weighed; ``carried``: or the robot may be anywhere."""
        ways = grouped(prior, self._lattice)
        before, self._lattice = self._lattice, self._lattice.moved(ways[0].step)
        parts = [
            (way.share, before.spread(self._cells, self._lattice, way.step, way.covariance, self._plane))
            for way in ways
        ]
        predicted = together(parts, self._plane)
        if carried:
            rest = 1.0 - ANYWHERE
            parts = [(rest * share, cells) for share, cells in parts]
            predicted = together([(rest, predicted), (ANYWHERE, self._everywhere())], self._plane)
        self._cells = predicted
        if not len(predicted.row):
            raise MclError("the belief has left the map", "start anew with another init or initial_pose")
        factor = self._weigh(reading, scan)
        self.followed = np.zeros(len(prior.components))
        for way, (share, cells) in zip(ways, parts, strict=True):
            of_way = 1.0
            if len(ways) > 1:
                lists = (cells.start, cells.row, cells.col, cells.weight)
                at = (predicted.start, predicted.row, predicted.col)
                of_way = share * sum_of_products(*lists, *at, factor, self._plane)
            self.followed[list(way.members)] = of_way * way.shares / way.share
        self.followed /= max(self.followed.sum(), 1e-300)

    def _everywhere(self) -> Cells:
        free = self._grid.free(self._config.free_threshold)
        if self._config.init == "map":
            free = np.ones_like(free)
        centre = (np.indices(self._plane.shape) + 0.5) * self._config.grid_d / self._grid.resolution
        row, col = (np.minimum(at.astype(np.int64), n - 1) for at, n in zip(centre, free.shape, strict=True))
        rows, cols = (at.astype(np.int32) for at in np.nonzero(free[row, col]))
        headings = len(self._lattice.shift)
        if len(rows) == 0:
            raise MclError("the map has no free cell to start in", "raise free_threshold")
        if len(rows) * headings > MOST_CELLS:
            says = f"a grid filter would need {len(rows) * headings:,} cells"
            raise MclError(says, "raise grid_d or grid_a, or start with init=pose")
        start = np.arange(headings + 1, dtype=np.int64) * len(rows)
        n = len(rows) * headings
        return Cells(start, np.tile(rows, headings), np.tile(cols, headings), np.full(n, 1.0 / n))

    def _around_pose(self) -> Cells:
        """A single cell at initial_pose, spread by initial_pose_std, which is told along the axes of the map."""
        size = self._config.grid_d
        x, y, yaw = (float(value) for value in self._grid.to_grid(np.array(self._config.initial_pose)))
        row, col = math.floor(y / size), math.floor(x / size)
        if not (0 <= row < self._plane.shape[0] and 0 <= col < self._plane.shape[1]):
            says = f"initial_pose {self._config.initial_pose} is not on the map"
            raise MclError(says, "give x, y in metres, yaw in radians")
        n = len(self._lattice.shift)
        shift = np.tile([x / size - col - 0.5, y / size - row - 0.5], (n, 1))
        self._lattice = Lattice(size, self._lattice.turn, shift, yaw)
        start = np.minimum(np.arange(n + 1), 1)
        one = Cells(start, np.array([row], np.int32), np.array([col], np.int32), np.ones(1))
        turn = yaw + self._grid.origin[2]  # the robot's, in the map
        cos, sin = math.cos(turn), math.sin(turn)
        into = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        noise = np.diag(np.maximum(self._config.initial_pose_std, 1e-6) ** 2)
        return self._lattice.spread(one, self._lattice, np.zeros(3), into @ noise @ into.T, self._plane)

    def _weigh(self, reading: Reading, scan: int) -> Array:
        """Table 8.1, line 4. Returns (n,) by what each predicted cell's weight was multiplied, up to a constant."""
        cells = self._cells
        poses = self._lattice.poses(cells)
        likelihood = np.empty(len(cells.row), np.float32)
        self._sensor.score(poses, reading, likelihood)
        gain = reading.temper * likelihood.astype(np.float64)
        log_weight = np.log(cells.weight) + gain
        log_weight -= log_weight.max()
        which = log_weight > -NEGLIGIBLE
        weight = np.exp(log_weight[which])
        weight /= weight.sum()
        self._cells = cells.kept(which, weight)
        self._show(np.ascontiguousarray(poses[:, which]), likelihood[which], scan)
        factor: Array = np.exp(gain - gain[which].max())
        return factor

    def _show(self, poses: NDArray[np.float32], likelihood: NDArray[np.float32], scan: int) -> None:
        """Fill in ``hypotheses`` and ``particles``."""
        p, weight = self.particles, self._cells.weight
        if len(weight) > self._room:
            self._room = 2 * len(weight)
            self._clusters = Clusters(self._grid, self._room)
        first, *others = self._clusters.find(poses, weight)
        x, y, yaw = self._grid.to_grid(first.pose)
        here = np.hypot(poses[0] - x, poses[1] - y) <= HERE[0]
        here &= np.abs(wrap_angle(poses[2] - yaw)) <= HERE[1]
        self.hypotheses = (dataclasses.replace(first, weight=float(weight[here].sum())), *others)
        if len(weight) > p.capacity:
            key = stream_key(self._seed, scan, SHOW)
            drawn = low_variance(weight, p.capacity, key)
            p.place(poses[:, drawn])
            p.log_likelihood[:] = likelihood[drawn]
            return
        p.place(poses)
        p.log_likelihood[:] = likelihood
        p.weights[:], p.log_weights[:] = weight, np.log(weight)
        p.ess = 1.0 / float(np.square(weight).sum())


@dataclasses.dataclass(frozen=True)
class Way:
    """Components of a prior that are one Gaussian to a lattice: which ``members``, each with its part of the way's
    ``share`` in ``shares``; ``step`` (3,) and ``covariance`` (3, 3) of them together, in the robot's frame."""

    members: tuple[int, ...]
    shares: Array
    step: Array
    covariance: Array

    @property
    def share(self) -> float:
        """Of the whole prior."""
        return float(self.shares.sum())


def grouped(prior: Prior, lattice: Lattice) -> list[Way]:
    """The prior's components, the heaviest first; those that a lattice, or anybody, can hardly tell apart are one.

    Within about a cell the weights of several Gaussians on a lattice add up to those of one with their common mean and
    covariance; and so they nearly do where the Gaussians themselves are alike.
    """
    components = prior.components
    shares = np.array([component.share for component in components])
    shares /= shares.sum()
    cell = np.array([lattice.size, lattice.size, lattice.turn])
    steps = np.array([component.step for component in components])
    spreads = np.array([np.diag(component.covariance) for component in components]) / cell**2
    groups: list[list[int]] = []
    for k in np.argsort(-shares, kind="stable").tolist():
        for group in groups:
            off = _apart(steps[k], steps[group[0]]) ** 2 / cell**2
            narrow, wide = np.minimum(spreads[k], spreads[group[0]]), np.maximum(spreads[k], spreads[group[0]])
            if (off + wide < NARROW).all() or ((off < 0.25 * narrow).all() and (wide < 2.0 * narrow).all()):
                group.append(k)
                break
        else:
            groups.append([k])
    ways = []
    for group in groups:
        part, off = shares[group] / shares[group].sum(), _apart(steps[group], steps[group[0]])
        mean = part @ off
        covariances = np.array([components[k].covariance for k in group])
        covariance = np.einsum("i,ijk->jk", part, covariances) + ((off - mean).T * part) @ (off - mean)
        ways.append(Way(tuple(group), shares[group], steps[group[0]] + mean, covariance))
    return sorted(ways, key=lambda way: -way.share)


def _apart(a: Array, b: Array) -> Array:
    """How far steps (..., 3) are from another one (3,)."""
    off = a - b
    off[..., 2] = wrap_angle(off[..., 2])
    return off
