"""Grid localization: the lattice that travels along, Bayes' rule cell by cell, and the filter as a whole."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.filter.grid_belief import GridBelief, grouped
from pipeline.filter.lattice import NARROW, WIDTHS, Cells, Lattice, gaussian_weights
from pipeline.filter.sensor import Reading, Sensor
from pipeline.filter.step import Step
from pipeline.geometry import compose, inverse, wrap_angle
from pipeline.kernels import raycast
from pipeline.localization import localize
from pipeline.logs.messages import Laser, Log
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.motion.models import Component
from pipeline.motion.prior import Prior

COARSE = {"filter": "grid", "grid_d": 0.2, "grid_a": 0.07}
PLANE = (120, 140)


def a_single_cell(lattice: Lattice, heading: int, row: int, col: int) -> Cells:
    start = (np.arange(len(lattice.shift) + 1) > heading).astype(np.int64)
    return Cells(start, np.array([row], np.int32), np.array([col], np.int32), np.ones(1))


def moments(lattice: Lattice, cells: Cells) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of x, y, yaw, about the heaviest cell's heading."""
    x, y, yaw = lattice.poses(cells).astype(np.float64)
    middle = yaw[np.argmax(cells.weight)]
    values = np.stack([x, y, wrap_angle(yaw - middle)])
    mean = values @ cells.weight / cells.weight.sum()
    off = values - mean[:, None]
    mean[2] += middle
    return mean, (off * cells.weight) @ off.T / cells.weight.sum()


def driven(step, covariance, times: int, *, size=0.1, turn=0.0525, heading: int = 9, yaw: float = 0.1):
    """A robot that makes the same step many times: lattice and cells, and the pose that it started from."""
    plane = np.zeros(PLANE)
    lattice = dataclasses.replace(Lattice.of(size, turn), yaw=yaw)
    cells = a_single_cell(lattice, heading, 50, 60)
    begun = lattice.poses(cells)[:, 0].astype(np.float64)
    for _ in range(times):
        to = lattice.moved(np.array(step))
        cells, lattice = lattice.spread(cells, to, np.array(step), np.array(covariance), plane), to
        heavy = cells.weight > 1e-14 * cells.weight.max()
        cells = cells.kept(heavy, cells.weight[heavy])
    return lattice, cells, begun


# --- the lattice -----------------------------------------------------------------------------------------------------


@given(st.floats(-3.0, 3.0), st.floats(1e-8, 30.0))
def test_whole_numbers_have_the_moments_of_a_gaussian(mean: float, variance: float) -> None:
    numbers, weights = gaussian_weights(mean, variance, 100)
    told = reference.whole_number_gaussian(mean, variance, 100, widths=WIDTHS, narrow=NARROW)
    found = dict(zip(numbers.tolist(), weights.tolist(), strict=True))
    assert {k: w for k, w in found.items() if w > 1e-12} == pytest.approx({k: w for k, w in told.items() if w > 1e-12})
    part = mean - math.floor(mean)
    assert weights.min() >= 0.0
    assert weights.sum() == pytest.approx(1.0)
    assert weights @ numbers == pytest.approx(mean, abs=0.01)
    assert weights @ (numbers - mean) ** 2 == pytest.approx(max(variance, part * (1 - part)), rel=0.01, abs=1e-9)


@pytest.mark.parametrize("heading", [0, 9, 37])
def test_a_robot_that_creeps_is_spread_by_the_noise_alone(heading: int) -> None:
    """A centimetre a scan, two hundred times, on cells of ten: the noise adds up, and nothing is added to it."""
    each = np.diag([0.002, 0.001, 0.0005]) ** 2
    step = np.array([0.01, 0.0, 0.0])
    lattice, cells, begun = driven(step, each, 200, heading=heading)
    mean, covariance = moments(lattice, cells)
    expected = np.zeros((3, 3))
    forward = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.01], [0.0, 0.0, 1.0]])
    for _ in range(200):
        expected = forward @ expected @ forward.T + each
    yaw = begun[2]
    turn = np.array([[math.cos(yaw), -math.sin(yaw), 0.0], [math.sin(yaw), math.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(mean[:2], compose(begun, [2.0, 0.0, 0.0])[:2], atol=0.005)
    found = np.sqrt(np.diag(turn.T @ covariance @ turn))
    np.testing.assert_allclose(found, np.sqrt(np.diag(expected)), rtol=0.15)


def test_a_robot_that_creeps_without_noise_stays_one_cell() -> None:
    lattice, cells, begun = driven([0.011, 0.003, 0.0], np.diag([1e-12] * 3), 200)
    assert cells.weight.max() > 0.9999
    np.testing.assert_allclose(
        lattice.poses(cells)[:, np.argmax(cells.weight)], compose(begun, [2.2, 0.6, 0.0]), atol=1e-4
    )


@pytest.mark.parametrize("rate", [0.004, -0.07, 0.3])
def test_a_robot_that_turns_on_the_spot_stays_there(rate: float) -> None:
    lattice, cells, begun = driven([0.0, 0.0, rate], np.diag([1e-12, 1e-12, 0.001**2]), 150)
    mean, covariance = moments(lattice, cells)
    np.testing.assert_allclose(mean[:2], begun[:2], atol=1e-5)
    assert wrap_angle(mean[2] - begun[2] - 150 * rate) == pytest.approx(0.0, abs=1e-4)
    assert covariance[2, 2] == pytest.approx(150 * 0.001**2, rel=0.05)
    assert covariance[0, 0] < 1e-8


def test_a_drive_in_a_circle_ends_where_it_began() -> None:
    steps = 100
    step = [0.05, 0.0, 2 * math.pi / steps]
    lattice, cells, begun = driven(step, np.diag([1e-12] * 3), steps)
    pose = begun
    for _ in range(steps):
        pose = compose(pose, step)
    np.testing.assert_allclose(lattice.poses(cells)[:2, np.argmax(cells.weight)], pose[:2], atol=1e-4)


def test_one_wide_step_is_a_gaussian() -> None:
    """Turn, and x and y that go along with it, two or three cells wide: against the density itself."""
    size, turn = 0.1, 2 * math.pi / 120
    covariance = np.array([[0.05, 0.01, 0.008], [0.01, 0.03, 0.012], [0.008, 0.012, 0.02]])
    step = np.array([0.33, -0.12, 0.2])
    plane = np.zeros(PLANE)
    lattice = Lattice.of(size, turn)
    cells = a_single_cell(lattice, 20, 60, 70)
    begun = lattice.poses(cells)[:, 0].astype(np.float64)
    to = lattice.moved(step)
    after = lattice.spread(cells, to, step, covariance, plane)
    mean, found = moments(to, after)
    c, s = math.cos(begun[2]), math.sin(begun[2])
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(mean, compose(begun, step), atol=0.002)
    np.testing.assert_allclose(found, rotation @ covariance @ rotation.T, atol=0.001)
    off = (to.poses(after).astype(np.float64).T - compose(begun, step)) @ rotation
    off[:, 2] = wrap_angle(off[:, 2])
    density = np.exp(-0.5 * np.einsum("ni,ij,nj->n", off, np.linalg.inv(covariance), off))
    density *= size**2 * turn / math.sqrt((2 * math.pi) ** 3 * np.linalg.det(covariance))
    assert 0.5 * np.abs(density - after.weight).sum() < 0.05  # total variation


# --- Bayes' rule -----------------------------------------------------------------------------------------------------

LASER = Laser((0.2, 0.0, 0.0), -math.pi / 2, math.pi / 36, beams=37, range_min=0.0, range_max=20.0)


def room(height: int, width: int, scans: int = 30, start=(1.2, 1.2, 0.0)) -> Log:
    """Empty, of so many cells of 0.1 m, its origin turned: every place has a twin, half a turn about the middle off."""
    cells = np.zeros((height, width), np.float32)
    cells[[0, -1]] = cells[:, [0, -1]] = 1.0
    grid = OccupancyGrid(cells, 0.1, (3.0, -2.0, 0.4))
    along = np.linspace(0, 1, scans)
    poses = np.column_stack([start[0] + 3.0 * along, start[1] + 0.6 * along**2, start[2] + 0.35 * along])
    ranges = np.empty((scans, LASER.beams), np.float32)
    opaque = (cells > 0.5).astype(np.uint8)
    raycast.cast(opaque, compose(poses, LASER.pose) / [0.1, 0.1, 1.0], LASER.angles, 500.0, False, ranges)
    stamps = np.arange(scans, dtype=np.int64) * 200_000_000
    return Log("room", Path("room.mcap"), "0" * 64, LASER, stamps, poses, ranges * np.float32(0.1), grid)


def belief_of(belief: GridBelief) -> np.ndarray:
    """(headings, height, width): the probability of every cell."""
    cells = belief._cells
    whole = np.zeros((len(belief._lattice.shift), *belief._plane.shape))
    whole[cells.heading, cells.row, cells.col] = cells.weight
    return whole


def likelihood(belief: GridBelief, sensor: Sensor, reading: Reading) -> np.ndarray:
    """(headings, height, width) of the scan in every cell, up to a constant."""
    shape = (len(belief._lattice.shift), *belief._plane.shape)
    every = np.indices(shape).reshape(3, -1).astype(np.int32)
    start = np.arange(shape[0] + 1) * shape[1] * shape[2]
    poses = belief._lattice.poses(Cells(start, every[1], every[2], np.ones(every.shape[1])))
    out = np.empty(poses.shape[1], np.float32)
    sensor.score(np.ascontiguousarray(poses), reading, out)
    return np.exp(reading.temper * (out.astype(float) - out.max())).reshape(shape)


def a_prior(k: int) -> Prior:
    """What laser and wheels might say: the laser surely, the wheels differently, loosely, and with correlations."""
    near = np.diag([0.01, 0.008, 0.02]) ** 2
    wide = np.array([[0.06, 0.01, 0.02], [0.01, 0.05, 0.03], [0.02, 0.03, 0.5]])
    step = np.array([0.08, 0.01, 0.1 * (-1) ** k])
    return Prior(
        (
            Component("laser", step, near, 0.6),
            Component("laser, loosely", step + np.array([0.01, 0.0, 0.02]), 4.0 * near, 0.1),
            Component("wheels", np.array([0.3, 0.1, 1.2]), wide, 0.3),
        )
    )


def test_it_is_bayes_rule_over_all_cells() -> None:
    """Against transition matrices over all cells of a small room: the same probability for every one of them."""
    log = room(14, 18, scans=6)
    config = Config(filter="grid", grid_d=0.2, grid_a=0.5, occupied_threshold=0.65, range_bias=0.0, odometry="wheels")
    sensor = Sensor(log.grid, LASER, config)
    belief = GridBelief(log.grid, config, sensor, 0)
    size, turn = belief._lattice.size, belief._lattice.turn
    readings = [sensor.read(ranges) for ranges in log.ranges]
    belief.start(readings[0], 0)
    free = np.zeros(belief._plane.shape)
    for i, j in np.ndindex(free.shape):  # the centre of a cell of 0.2 m is the corner of four of 0.1 m
        free[i, j] = 0 < 2 * i + 1 < 13 and 0 < 2 * j + 1 < 17
    expected = free * likelihood(belief, sensor, readings[0])
    expected /= expected.sum()
    np.testing.assert_allclose(belief_of(belief), expected, atol=1e-9)
    for k, reading in enumerate(readings[1:]):
        prior, before = a_prior(k), belief._lattice
        ways = grouped(prior, before)
        belief.advance(prior, reading, k + 1)
        predicted = np.zeros(expected.size)
        of_way = []
        for way in ways:
            transition = reference.lattice_transition(
                (size, turn, before.shift, before.yaw), (size, turn, belief._lattice.shift, belief._lattice.yaw),
                way.step, way.covariance, belief._plane.shape, widths=WIDTHS, narrow=NARROW,
            )  # fmt: skip
            of_way.append(way.share * expected.reshape(-1) @ transition)
            predicted += of_way[-1]
        gain = likelihood(belief, sensor, reading).reshape(-1)
        followed = np.array([(part * gain).sum() for part in of_way])
        expected = (predicted * gain).reshape(expected.shape)
        expected /= expected.sum()
        np.testing.assert_allclose(belief_of(belief), expected, atol=1e-7)
        told = [belief.followed[list(way.members)].sum() for way in ways]
        np.testing.assert_allclose(told, followed / followed.sum(), atol=1e-6)
        assert belief.followed.sum() == pytest.approx(1.0)


def test_what_is_nearly_the_same_is_one_gaussian() -> None:
    """The laser and the laser, loosely: together, with their common mean and covariance; the wheels alone."""
    first, second = grouped(a_prior(0), Lattice.of(0.1, 0.2))
    assert (first.members, second.members) == ((0, 1), (2,))
    assert first.share == pytest.approx(0.7)
    rng = np.random.default_rng(0)
    draws = np.vstack(
        [
            rng.multivariate_normal(component.step, component.covariance, n)
            for component, n in zip(a_prior(0).components, (600_000, 100_000), strict=False)
        ]
    )
    np.testing.assert_allclose(first.step, draws.mean(axis=0), atol=1e-4)
    np.testing.assert_allclose(first.covariance, np.cov(draws.T), atol=1e-5)


def test_without_noise_it_is_the_likelihood_of_the_whole_way() -> None:
    """Every start is as good as its way explains all scans: a sum that needs no filter."""
    log = room(40, 60, scans=12)
    plain = {"occupied_threshold": 0.65, "range_bias": 0.0, "independent_beams": 0.3}
    config = Config(filter="grid", grid_d=0.1, grid_a=0.2, **plain)
    sensor = Sensor(log.grid, LASER, config)
    belief = GridBelief(log.grid, config, sensor, 0)
    readings = [sensor.read(ranges) for ranges in log.ranges]
    belief.start(readings[0], 0)
    for k, reading in enumerate(readings[1:], 1):
        step = compose(inverse(log.odometry[k - 1]), log.odometry[k])
        belief.advance(Prior((Component("laser", step, np.diag([1e-14] * 3)),)), reading, k)
    ends = belief._lattice.poses(belief._cells)
    total = np.zeros(ends.shape[1])
    for k, reading in enumerate(readings):
        back = compose(inverse(log.odometry[-1]), log.odometry[k])
        at = np.ascontiguousarray(compose(ends.T.astype(float), back).T.astype(np.float32))
        out = np.empty(ends.shape[1], np.float32)
        sensor.score(at, reading, out)
        total += reading.temper * out
    told = np.log(belief._cells.weight)
    likely = told > told.max() - 8.0
    assert likely.sum() > 20
    # A pose on the border of two cells of the table may be rounded into either.
    off = (told - total - (told - total)[np.argmax(told)])[likely]
    assert np.mean(np.abs(off) < 0.01) > 0.9


# --- the filter ------------------------------------------------------------------------------------------------------


class Keep:
    """Keeps every step, with copies of what the next one writes over."""

    def __init__(self) -> None:
        self.steps: list[Step] = []

    def log(self, step: Step) -> None:
        particles, weights = step.particles.copy(), step.log_weights.copy()
        self.steps.append(dataclasses.replace(step, particles=particles, log_weights=weights))


def shortened(log: Log, scans: int) -> Log:
    return dataclasses.replace(log, stamps=log.stamps[:scans], odometry=log.odometry[:scans], ranges=log.ranges[:scans])


@pytest.fixture(scope="module")
def found(office: Log):
    keep = Keep()
    return localize(office, Config(**COARSE), sinks=[keep]), keep.steps


def test_it_finds_the_robot_in_the_office(office: Log, found) -> None:
    result, _ = found
    truth = office.ground_truth.poses
    off = np.hypot(*(result.poses - truth)[:, :2].T)
    turned = np.abs(wrap_angle(result.poses[:, 2] - truth[:, 2]))
    late = office.times > 6.0
    assert ((off < 0.5) & (turned < math.radians(10.0)))[late].all()
    assert np.median(off[late]) < 0.1
    assert np.hypot(*(result.hindsight - truth)[:, :2].T).max() < 0.5
    assert [event.kind for _, _, event in result.events if event.kind in ("started", "converged", "lost")] == [
        "started",
        "converged",
    ]
    assert 2.0 < result.converged_at < 6.0


def test_its_steps_are_those_of_any_filter(found) -> None:
    result, steps = found
    for step in steps:
        assert np.exp(step.log_weights).sum() == pytest.approx(1.0)
        assert len(step.particles) <= Config().max_particles
        assert 0.0 < step.estimate.weight <= 1.0 + 1e-9
        assert (np.linalg.eigvalsh(step.estimate.covariance) >= -1e-9).all()
        assert step.followed is None or step.followed.sum() == pytest.approx(1.0)
        x, y, yaw = step.estimate.pose
        near = np.hypot(step.particles[:, 0] - x, step.particles[:, 1] - y) <= 0.5
        near &= np.abs(wrap_angle(step.particles[:, 2] - yaw)) <= math.radians(10.0)
        if len(step.particles) < Config().max_particles:  # all cells, and not some that were drawn
            # Which of the cells on the border are in depends on the last bit.
            assert step.estimate.weight == pytest.approx(np.exp(step.log_weights[near]).sum(), abs=0.02)
    np.testing.assert_array_equal(result.weights, [step.estimate.weight for step in steps])
    assert len(steps[0].particles) == Config().max_particles  # everywhere at once
    assert len(steps[-1].particles) < 1000


def test_the_same_with_any_number_of_threads(office: Log) -> None:
    some = shortened(office, 40)
    one, two = (localize(some, Config(**COARSE), threads=threads) for threads in (1, 2))
    assert one.poses.tobytes() == two.poses.tobytes()
    assert one.hindsight.tobytes() == two.hindsight.tobytes()
    assert one.ess.tobytes() == two.ess.tobytes()


def test_two_places_that_look_alike_have_half_of_the_belief_each() -> None:
    """A particle filter loses one of them sooner or later; a grid cannot."""
    log = room(60, 80, scans=60)
    config = Config(filter="grid", grid_a=0.07, occupied_threshold=0.65, range_bias=0.0, hindsight=False)
    keep = Keep()
    localize(log, config, sinks=[keep])
    here = log.odometry[-1]
    there = np.array([8.0 - here[0], 6.0 - here[1], here[2] + math.pi])
    last = keep.steps[-1]
    for place in (here, there):
        x, y, yaw = log.grid.to_map(place)
        near = np.hypot(last.particles[:, 0] - x, last.particles[:, 1] - y) < 0.3
        near &= np.abs(wrap_angle(last.particles[:, 2] - yaw)) < 0.2
        assert np.exp(last.log_weights[near]).sum() == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("std", [(0.0, 0.0, 0.0), (0.3, 0.1, 0.05)])
def test_a_given_start(std) -> None:
    """A Gaussian along the axes of the map, whose origin is turned here."""
    log = room(60, 80, scans=1)
    pose = log.grid.to_map([3.13, 2.57, 0.9])
    config = Config(**COARSE, init="pose", initial_pose=tuple(pose), initial_pose_std=std, independent_beams=1e-9)
    keep = Keep()
    localize(log, config, sinks=[keep])  # a scan that says next to nothing
    weights = np.exp(keep.steps[0].log_weights)
    off = keep.steps[0].particles - pose
    off[:, 2] = wrap_angle(off[:, 2])
    np.testing.assert_allclose(weights @ off, 0.0, atol=0.005)
    spread = (weights * off.T) @ off
    np.testing.assert_allclose(spread, np.diag(np.square(std)), atol=0.003)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"grid_d": 0.02, "grid_a": 0.005}, "a grid filter would need .* cells"),
        ({"init": "pose", "initial_pose": (500.0, 0.0, 0.0)}, "initial_pose .* is not on the map"),
        ({"free_threshold": 0.0}, "the map has no free cell"),
    ],
)
def test_what_cannot_be_started(office: Log, values, said: str) -> None:
    with pytest.raises(MclError, match=said):
        localize(shortened(office, 2), Config(**(COARSE | values)))
