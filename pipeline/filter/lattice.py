"""The poses that a grid filter tells apart: a lattice that travels with the robot, and the moves between its cells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.geometry import wrap_angle
from pipeline.kernels import lattice

Array = NDArray[np.float64]

WIDTHS = 4.0
"""Deviations to which a Gaussian reaches."""
NARROW = 0.5
"""Cells^2: below this variance a Gaussian at the cells' centres would have another one; then three weights are better
that have its mean and variance (a locally consistent chain: Kushner and Dupuis, 1992)."""
NOTHING = 1e-9
"""A share below this is none."""


@dataclass(frozen=True)
class Cells:
    """Weighted cells, heading by heading: those of heading h are ``start[h]`` to ``start[h + 1]`` of the others.

    ``start`` (headings + 1,) int64; ``row``, ``col`` (n,) int32; ``weight`` (n,) float64.
    """

    start: NDArray[np.int64]
    row: NDArray[np.int32]
    col: NDArray[np.int32]
    weight: Array

    @property
    def heading(self) -> NDArray[np.int64]:
        """(n,) of each cell."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))

    def kept(self, which: NDArray[np.bool_], weight: Array) -> Cells:
        """Only these (n,) of the cells, with new weights."""
        start = np.concatenate([[0], np.cumsum(which)])[self.start]
        return Cells(start, self.row[which], self.col[which], weight)


@dataclass(frozen=True)
class Moves:
    """What moves where: heading ``target[e]`` takes ``share[e]`` of what heading ``source[e]`` has, moved by so many
    rows and columns; (m,) each."""

    target: NDArray[np.int64]
    source: NDArray[np.int64]
    down: NDArray[np.int64]
    right: NDArray[np.int64]
    share: Array

    def __call__(self, cells: Cells, plane: Array) -> Cells:
        """The cells once they have moved; ``plane`` (height, width) zeros to work in, which are zeros again then."""
        order = np.flatnonzero(self.share > NOTHING)
        order = order[np.argsort(self.target[order], kind="stable")]
        headings = int(self.target.max()) + 1
        first = np.searchsorted(self.target[order], np.arange(headings + 1))
        moves = (first, *(values[order] for values in (self.source, self.down, self.right, self.share)))
        room = 2 * len(cells.row) + 1024
        while True:
            start, weight = np.empty(headings + 1, np.int64), np.empty(room)
            row, col = np.empty(room, np.int32), np.empty(room, np.int32)
            n = lattice.spread(cells.start, cells.row, cells.col, cells.weight, *moves, plane, start, row, col, weight)
            if n >= 0:
                return Cells(start, row[:n], col[:n], weight[:n])
            room *= 2


def together(parts: list[tuple[float, Cells]], plane: Array) -> Cells:
    """The sum of several beliefs, each times its share."""
    if len(parts) == 1:
        return parts[0][1]
    headings = len(parts[0][1].start) - 1
    begin = np.cumsum([0] + [len(cells.row) for _, cells in parts[:-1]])
    ends = [cells.start[1:] + offset for (_, cells), offset in zip(parts, begin, strict=True)]
    start = np.concatenate([[0], *ends])
    every = Cells(start, *(np.concatenate([getattr(c, name) for _, c in parts]) for name in ("row", "col", "weight")))
    target = np.tile(np.arange(headings), len(parts))
    still = np.zeros(len(target), np.int64)
    share = np.repeat([share for share, _ in parts], headings)
    return Moves(target, np.arange(len(target)), still, still, share)(every, plane)


@dataclass(frozen=True)
class Lattice:
    """Headings ``turn`` rad apart, and for each a square grid of cells with edges of ``size`` m, all of which make
    every move of the robot, each in its own direction.

    So a belief that moves stays in its cells, however short the step, and only noise takes it from one to another.
    ``shift`` (headings, 2): x, y, in cells, by which each heading's grid lies off the map's corner, within half a cell;
    ``yaw``: heading of the first one, rad, grid frame.
    """

    size: float
    turn: float
    shift: Array
    yaw: float = 0.0

    @classmethod
    def of(cls, size: float, turn: float) -> Lattice:
        """A lattice in its first place, with headings as near ``turn`` apart as divides a full turn."""
        headings = max(4, round(2.0 * math.pi / turn))
        return cls(size, 2.0 * math.pi / headings, np.zeros((headings, 2)))

    @property
    def headings(self) -> Array:
        """(headings,) rad."""
        return np.asarray(self.yaw + self.turn * np.arange(len(self.shift)), np.float64)

    def poses(self, cells: Cells) -> NDArray[np.float32]:
        """(3, n) m, m, rad: the centres of cells, in the grid frame."""
        heading = cells.heading
        x = (cells.col + 0.5 + self.shift[heading, 0]) * self.size
        y = (cells.row + 0.5 + self.shift[heading, 1]) * self.size
        return np.stack([x, y, wrap_angle(self.headings)[heading]]).astype(np.float32)

    def moved(self, step: Array) -> Lattice:
        """The lattice after a step (3,) m, m, rad of the robot, in the robot's frame."""
        shift = self.shift + _turned(self.headings, step[:2]) / self.size
        return Lattice(self.size, self.turn, shift - np.round(shift), float(wrap_angle(self.yaw + step[2])))

    def spread(self, cells: Cells, to: Lattice, step: Array, covariance: Array, plane: Array) -> Cells:
        """The cells' weights on the lattice ``to`` after a step (3,) with Gaussian noise (3, 3), both in the
        robot's frame: first in heading, with what that implies of x and y, then along the axes of the map."""
        turning, excess = self._turning(to, step, covariance)
        along, across = to._drifting(step, covariance, excess, plane.shape)
        return across(along(turning(cells, plane), plane), plane)

    def _turning(self, to: Lattice, step: Array, covariance: Array) -> tuple[Moves, Array]:
        """The move by the step and its noise in heading; and (headings, 2) cells^2, the variance along x and y that
        arises since cells of different headings do not lie one on the other."""
        n = len(self.shift)
        mean = float(wrap_angle(step[2] - (to.yaw - self.yaw))) / self.turn
        turns, share = gaussian_weights(mean, covariance[2, 2] / self.turn**2, (n - 1) // 2)
        # Who turned farther than most also ended elsewhere: the mean of the rest of the noise, given the turn.
        off = (turns - mean) * self.turn / covariance[2, 2]
        ends = step[:2] + off[:, None] * covariance[:2, 2]
        target = (np.arange(n)[:, None] + turns) % n
        at = self.shift[:, None] + _turned(self.headings, ends) / self.size - to.shift[target]
        whole, part = _split(at)
        excess = np.zeros((n, 2))
        np.add.at(excess, target, share[:, None] * part * (1.0 - part))
        # The four cells around the end have it as their mean (bilinear).
        (x, right), (y, down) = ((part[..., k], whole[..., k]) for k in (0, 1))
        source, sides = (
            np.arange(n)[:, None],
            [(0, 1.0 - y, 0, 1.0 - x), (0, 1.0 - y, 1, x), (1, y, 0, 1.0 - x), (1, y, 1, x)],
        )
        ways = [(target, source, down + i, right + j, share * of_y * of_x) for i, of_y, j, of_x in sides]
        return _moves(ways), excess

    def _drifting(self, step: Array, covariance: Array, excess: Array, shape: tuple[int, ...]) -> tuple[Moves, Moves]:
        """The noise along x and y, given the turn, less the variance that is there already: along the axis that has
        more of it, with what that implies of the other, and then along that one."""
        n, most = len(self.shift), max(shape)
        given = covariance[:2, :2] - np.outer(covariance[:2, 2], covariance[:2, 2]) / covariance[2, 2]
        yaw = self.headings - step[2]  # before the move
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        xx, xy, _, yy = np.einsum("ikh,kl,jlh->ijh", turn, given, turn).reshape(4, n) / self.size**2
        xx, yy = np.maximum(xx - excess[:, 0], 0.0), np.maximum(yy - excess[:, 1], 0.0)
        by_column = xx >= yy
        much, little = np.where(by_column, xx, yy), np.where(by_column, yy, xx)
        both = np.sqrt(much * little)
        slope = np.clip(xy, -both, both) / np.maximum(much, NOTHING)
        far, share = gaussian_weights(np.zeros(n), much, most)
        whole, part = _split(slope[:, None] * far)
        skewed = (share * part * (1.0 - part)).sum(axis=1)
        near, rest = gaussian_weights(np.zeros(n), np.maximum(little - slope**2 * much - skewed, 0.0), most)
        return (
            _along(by_column, [(far, whole, share * (1.0 - part)), (far, whole + 1, share * part)]),
            _along(~by_column, [(near, 0 * near, rest)]),
        )


def gaussian_weights(mean: ArrayLike, variance: ArrayLike, most: int) -> tuple[NDArray[np.int64], Array]:
    """Whole numbers (..., k) and weights for them with the mean and the variance of a Gaussian, where that can be.

    ``mean``, ``variance`` (...). Weights of whole numbers cannot have a smaller variance than f (1 - f) about a mean
    that is a fraction f off one of them. At most ``most`` numbers to either side.
    """
    mean, variance = np.asarray(mean, np.float64)[..., None], np.asarray(variance, np.float64)[..., None]
    nearest = np.round(mean)
    part = mean - nearest
    reach = min(most, max(1, math.ceil(WIDTHS * math.sqrt(float(variance.max())))))
    k = np.arange(-reach, reach + 1)
    wide = np.exp(-0.5 * (k - part) ** 2 / np.maximum(variance, NARROW))
    wide /= wide.sum(axis=-1, keepdims=True)
    second = np.maximum(variance + part**2, np.abs(part))
    three = np.where(k == 0, 1.0 - second, np.where(np.abs(k) == 1, 0.5 * (second + k * part), 0.0))
    return (nearest + k).astype(np.int64), np.where(variance < NARROW, three, wide)


def _turned(yaw: Array, to: Array) -> Array:
    """Vectors (..., 2), each turned by every yaw (h,): (h, ..., 2)."""
    yaw = yaw.reshape(-1, *[1] * (to.ndim - 1))
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.stack([cos * to[..., 0] - sin * to[..., 1], sin * to[..., 0] + cos * to[..., 1]], axis=-1)


def _split(at: Array) -> tuple[NDArray[np.int64], Array]:
    """Whole cells, and the part of one that is left over; what rounding alone leaves over is none."""
    at = np.round(at, 9)
    whole = np.floor(at)
    return whole.astype(np.int64), at - whole


def _along(by_column: NDArray[np.bool_], ways: list[tuple[NDArray[np.int64], NDArray[np.int64], Array]]) -> Moves:
    """Moves within each heading (headings,): so many cells along one axis and so many along the other, with a share."""
    heading, columns = np.arange(len(by_column))[:, None], by_column[:, None]
    return _moves(
        [
            (heading, heading, np.where(columns, other, this), np.where(columns, this, other), share)
            for this, other, share in ways
        ]
    )


def _moves(ways: Sequence[tuple[NDArray[Any], ...]]) -> Moves:
    """All of them in one list: target, source, rows, columns and share of each, broadcast."""
    columns = zip(*(np.broadcast_arrays(*way) for way in ways), strict=True)
    return Moves(*(np.concatenate([part.reshape(-1) for part in column]) for column in columns))
