"""The kernels: scoring beside its baselines, whole updates, resampling, the search of a building."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pipeline.bench.measure import Row, cores, measured, ratios, row, seconds
from pipeline.config import Config, load_config
from pipeline.filter.belief import Belief
from pipeline.filter.estimate import Clusters
from pipeline.filter.initialization import initial_particles
from pipeline.filter.resampling import low_variance
from pipeline.filter.search import Search
from pipeline.filter.sensor import Reading, Sensor
from pipeline.kernels.baseline import score_plainly
from pipeline.kernels.random import stream_key
from pipeline.kernels.threads import use_threads
from pipeline.logs.messages import Log, Scan
from pipeline.maps.range_table import HEADINGS
from pipeline.maps.walls import wall_half_thickness
from pipeline.motion.models import motion_model
from pipeline.motion.prior import Prior, motion_prior
from pipeline.motion.witnesses import Motion
from pipeline.world.expected_ranges import ExpectedRanges, select_beams

POSES = 200_000
"""Random poses of the scoring rows."""
CHUNK = 10_000
"""So many at a time for NumPy, which needs some hundred times the memory for its look-ups."""
SEARCH_BEAMS = 36
DRIVE = 20
"""Scans from the first to the one whose motion an update is measured with."""


class Bench:
    """Poses, a scan, and everything that scores them, for so many particles and beams."""

    def __init__(self, log: Log, particles: int, beams: int) -> None:
        assert log.grid is not None
        grid = log.grid
        longest = log.laser.longest(None)
        self.config: Config = load_config(
            max_beams=min(beams, log.laser.beams), max_particles=particles, min_particles=min(100, particles),
            adaptive="none", init="free_space", recovery="none", laser_max_range=longest,
        )  # fmt: skip
        self.sensor = Sensor(grid, log.laser, self.config)
        chosen, thickness = (
            select_beams(log.laser, self.config),
            wall_half_thickness(grid, grid.wall_threshold(self.config.occupied_threshold)),
        )
        self.expected = ExpectedRanges(grid, log.laser, chosen, self.config, longest, thickness)
        scans = [scan for scan, _ in zip(log.scans(), range(DRIVE + 1), strict=False)]
        self.scan: Scan = scans[0]
        first, last = (
            Motion(scan.time, scan.odometry, None, None, scan.odometry, scan.ranges) for scan in (scans[0], scans[-1])
        )
        self._prior: Prior = motion_prior(first, last, self.config, motion_model(self.config))
        self.reading: Reading = self.sensor.read(self.scan.ranges)
        self.beams = len(chosen)
        self.poses = initial_particles(grid, self.config, int(stream_key(0, 0, 0)))
        self.belief = Belief(grid, self.config, self.sensor, 0)
        self._clusters = Clusters(grid, particles)

    def score(self, poses: NDArray[np.float32], out: NDArray[np.float32]) -> None:
        """The sensor model alone."""
        self.sensor.score(poses, self.reading, out)

    def place(self) -> None:
        """Random poses again, all of equal weight: what an update starts from."""
        self.belief.particles.place(self.poses)

    def update(self) -> None:
        """One turn of the belief, all of it: read a scan, move, score, find the hypotheses, resample."""
        self.belief.advance(self._prior, self.sensor.read(self.scan.ranges), 1)
        self.resample()

    def resample(self) -> None:
        """Survivors replace the particles."""
        p = self.belief.particles
        p.survive(low_variance(p.weights, p.n, stream_key(0, 1, 2)))

    def estimate(self) -> None:
        """The hypotheses among the particles."""
        p = self.belief.particles
        self._clusters.find(p.poses, p.weights)

    def updates(self, repeats: int) -> list[float]:
        """Seconds of an update from random poses; putting them there does not count. The first one neither."""
        times = max(1, 20_000 // self.config.max_particles)  # a short one is made many times over
        taken = []
        for _ in range((repeats + 1) * times):
            self.place()
            taken.append(seconds(self.update))
        return [sum(taken[k : k + times]) / times for k in range(times, len(taken), times)]


def scoring(log: Log, repeats: int) -> list[Row]:
    """All rows of the kernels."""
    return [*_scores(log, repeats), *_updates(log, repeats), *_resampling(log, repeats), *_search(log, repeats)]


def _scores(log: Log, repeats: int) -> list[Row]:
    b = Bench(log, POSES, log.laser.beams)
    order = np.lexsort((b.poses[2], b.poses[0] // 0.1, b.poses[1] // 0.1))
    ordered = np.ascontiguousarray(b.poses[:, order])
    noise = np.random.default_rng(0).standard_normal((3, POSES)) * np.array([[0.15], [0.15], [0.03]])
    settled = (b.poses[:, :1] + noise).astype(np.float32)
    out = np.empty(POSES, np.float32)
    works = [lambda p=p: b.score(p, out[: p.shape[1]]) for p in (b.poses, ordered, settled)]
    with use_threads(1):
        random, by_cell, together, numpy, plain = measured(repeats, [*works, _numpy(b), _plainly(b)])
    label, unit = f"{b.beams} beams, one thread", "ns a particle-beam"
    each = 1e9 / (POSES * b.beams)
    return [
        row(f"scoring random poses, {label}", unit, [each * s for s in random]),
        row(f"scoring poses sorted by cell, {label}", unit, [each * s for s in by_cell]),
        row(f"scoring poses within 0.3 m, {label}", unit, [each * s for s in together]),
        row(f"the same look-ups by np.take, {label}", unit, [each * s for s in numpy]),
        row(f"the density worked out per beam, {label}", unit, [each * s for s in plain]),
        row("scoring random poses, over np.take", "times", ratios(numpy, random)),
        row("scoring random poses, over the density per beam", "times", ratios(plain, random)),
    ]


def _numpy(b: Bench) -> Callable[[], object]:
    """The same look-ups in the same table, as np.take makes them."""
    expected, likelihood = b.expected, b.reading.rows.reshape(-1)
    x, y, turn, cells, headings, row_of_cell = expected.place
    height, width = row_of_cell.shape
    table, beams = expected.rows.reshape(-1), 256 * np.arange(b.beams)
    out = np.empty(b.poses.shape[1], np.float32)

    def score() -> None:
        for first in range(0, len(out), CHUNK):
            poses = b.poses[:, first : first + CHUNK]
            cos, sin = np.cos(poses[2]), np.sin(poses[2])
            col = np.clip(((poses[0] + cos * x - sin * y) * cells).astype(np.int64), 0, width - 1)
            line = np.clip(((poses[1] + sin * x + cos * y) * cells).astype(np.int64), 0, height - 1)
            heading = np.floor((poses[2] + turn) * headings / (2 * np.pi) + 0.5).astype(np.int64) % headings
            row = row_of_cell[line, col].astype(np.int64)
            place = np.maximum(row, 0) * expected.rows.shape[1] + heading
            codes = np.take(table, place[:, None] + expected.offsets)
            total = np.take(likelihood, codes + beams).sum(axis=1)
            out[first : first + CHUNK] = np.where(row < 0, b.reading.outside, total)

    return score


def _plainly(b: Bench) -> Callable[[], object]:
    """A table of ranges in metres, and the densities of a beam worked out each time."""
    expected, config, out = b.expected, b.config, np.empty(b.poses.shape[1], np.float32)
    longest = expected.codes.max_range
    ranges = np.minimum(expected.codes.ranges, longest).astype(np.float32)[expected.rows[:, :HEADINGS]]
    weights = config.z_hit, config.z_short, max(config.z_max, 1e-6), config.z_rand
    mixture = np.array([*weights, config.sigma_hit, config.lambda_short])
    rest = (ranges, expected.offsets, b.reading.ranges, mixture, longest, np.float32(b.reading.outside), out)
    return lambda: score_plainly(0, *b.poses, *expected.place, *rest)


def _updates(log: Log, repeats: int) -> list[Row]:
    every, rows = log.laser.beams, []
    for particles, beams, scale, unit in (
        (500, 36, 1e6, "us"),
        (100_000, every, 1e3, "ms"),
        (1_000_000, every, 1.0, "s"),
    ):
        b = Bench(log, particles, beams)
        with use_threads(cores()):
            taken = b.updates(repeats)
        label = f"{particles:,} particles x {b.beams} beams"
        rows.append(row(f"full update, {label}", unit, [scale * s for s in taken]))
        if particles == 100_000 and cores() > 1:
            with use_threads(1):
                alone = b.updates(repeats)
            rows.append(row(f"full update, {label}, {cores()} threads over one", "times", ratios(alone, taken)))
        if particles == 1_000_000:
            out = np.empty(particles, np.float32)
            (scores,) = measured(repeats, [lambda b=b, out=out: b.score(b.poses, out)])  # type: ignore[misc]
            rows.append(row(f"full update, {label}", "scans a second", [1.0 / s for s in taken]))
            rows.append(row(f"scoring {label}, random poses", "s", scores))
    return rows


def _resampling(log: Log, repeats: int) -> list[Row]:
    b = Bench(log, 100_000, 36)
    taken = []
    for _ in range(repeats + 1):
        b.place()
        b.belief.weigh(b.reading)
        taken.append(seconds(b.resample) + seconds(b.estimate))
    return [row("resampling and estimate, 100,000 particles", "ms", [1e3 * s for s in taken[1:]])]


def _search(log: Log, repeats: int) -> list[Row]:
    assert log.grid is not None
    b = Bench(log, 1000, SEARCH_BEAMS)
    search = Search(log.grid, log.laser, b.expected, b.config.free_threshold)
    scan = (b.reading.rows, b.config.independent_beams, 1000, stream_key(0, 0, 0))
    taken, coarse = measured(repeats, [lambda: search(*scan, beams=SEARCH_BEAMS), lambda: search(*scan, coarse=True)])
    label = f"{search.cells:,} cells x {HEADINGS} headings x {b.beams} beams"
    return [row(f"search: {label}", "s", taken), row("search, as recovery makes it", "s", coarse)]
