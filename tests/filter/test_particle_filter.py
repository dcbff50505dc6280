"""The filter as a whole: in the simulated office, whose truth is known, and in a room alike from two ends."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.filter.particle_filter import ParticleFilter
from pipeline.filter.step import Step
from pipeline.geometry import between, compose, wrap_angle
from pipeline.kernels import raycast
from pipeline.kernels.threads import use_threads
from pipeline.logs.messages import Laser, Log, Scan
from pipeline.maps.occupancy_grid import OccupancyGrid

# Nothing but the plain filter, and what the simulated map needs: its walls are neither smeared nor thick.
PLAIN = {
    "occupied_threshold": 0.65,
    "range_bias": 0.0,
    "recovery": "none",
    "adaptive": "none",
    "hindsight": False,
}


def known_start(log: Log, **values) -> Config:
    assert log.ground_truth is not None
    start = tuple(log.ground_truth.poses[0].tolist())
    return Config(
        **(PLAIN | {"init": "pose", "initial_pose": start, "initial_pose_std": (0.2, 0.2, 0.1), "max_particles": 2000})
        | values
    )


def kept(step: Step) -> Step:
    """A step that outlives the next one: its arrays are views into the filter."""
    return dataclasses.replace(step, particles=step.particles.copy(), log_weights=step.log_weights.copy())


def run(log: Log, config: Config, scans: int | None = None, *, seed: int = 0, threads: int | None = None) -> list[Step]:
    assert log.grid is not None
    with use_threads(threads):
        mcl = ParticleFilter(log.grid, log.laser, config, seed)
        return [kept(mcl.update(scan)) for scan in list(log.scans())[:scans]]


def contents(step: Step) -> list[bytes]:
    """Every bit of a step."""
    arrays = [step.particles, step.log_weights]
    for estimate in (step.estimate, *step.clusters):
        arrays += [estimate.pose, estimate.covariance, np.array(estimate.weight)]
    arrays += [step.beams.laser, step.beams.angles, step.beams.measured, step.beams.expected]
    arrays += [np.array([step.ess, step.mean_likelihood, step.explained, step.spread])]
    about = repr((step.index, step.stamp, step.time, step.moved, step.resampled, step.events))
    return [np.ascontiguousarray(a).tobytes() for a in arrays] + [about.encode()]


# --- the same every time ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "values",
    [
        {"init": "free_space", **PLAIN},
        {"init": "exhaustive"},
        {"init": "free_space", "recovery": "augmented", "adaptive": "duplicates", "resampler": "multinomial"},
    ],
    ids=["plain", "defaults", "multinomial"],
)
def test_the_same_steps_with_any_number_of_threads(office: Log, values) -> None:
    config = Config(max_particles=12_000, **values)
    one, two, again = (run(office, config, 30, seed=5, threads=n) for n in (1, 2, None))
    for steps in (two, again):
        for a, b in zip(one, steps, strict=True):
            assert contents(a) == contents(b)


def test_another_seed_another_run(office: Log) -> None:
    config = known_start(office)
    a, b = run(office, config, 10, seed=1), run(office, config, 10, seed=2)
    assert not np.array_equal(a[0].particles, b[0].particles)
    for one, other in zip(a[1:], b[1:], strict=True):
        assert contents(one) != contents(other)


# --- where the robot is ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("caster", "scans"), [("table", None), ("dda", 120), ("bresenham", 120)])
def test_a_known_start_is_tracked(office: Log, caster: str, scans: int | None) -> None:
    """Through people, glass and doors that moved, forwards and backwards, for 434 scans."""
    steps = run(office, known_start(office, ray_caster=caster), scans)
    truth = office.ground_truth.poses
    for step in steps:
        assert math.dist(step.estimate.pose[:2], truth[step.index, :2]) < 0.3
        assert abs(wrap_angle(step.estimate.pose[2] - truth[step.index, 2])) < 0.15


def test_a_known_start_is_tracked_with_every_default(office: Log) -> None:
    """The search for rivals, the learned bias and fewer particles do it no harm."""
    steps = run(office, known_start(office, **{key: Config.model_fields[key].default for key in PLAIN}), 100)
    errors = [math.dist(step.estimate.pose[:2], office.ground_truth.poses[step.index, :2]) for step in steps]
    assert max(errors) < 0.3


def test_the_scans_hold_the_robot_where_odometry_would_lose_it(office: Log) -> None:
    """With odometry alone the particles drift apart: it is the laser that keeps them together."""
    steps = run(office, known_start(office), 250)
    blind = dataclasses.replace(office, ranges=np.full_like(office.ranges, np.nan))
    lost = run(blind, known_start(office), 250)
    assert lost[-1].spread > 5 * steps[-1].spread
    assert np.median([s.spread for s in steps]) < 0.25


LASER = Laser((0.2, 0.0, 0.0), -math.pi / 2, math.pi / 36, beams=37, range_min=0.0, range_max=20.0)


def symmetric_room(scans: int = 60) -> Log:
    """8 m x 6 m, empty: every place has a twin, half a turn about the middle away. Exact ranges, exact odometry."""
    cells = np.zeros((60, 80), np.float32)
    cells[[0, -1]] = cells[:, [0, -1]] = 1.0
    grid = OccupancyGrid(cells, 0.1, (3.0, -2.0, 0.4))
    along = np.linspace(0, 1, scans)
    poses = np.column_stack([1.2 + 3.0 * along, 1.2 + 0.6 * along**2, 0.35 * along])
    laser = compose(poses, LASER.pose)
    ranges = np.empty((scans, LASER.beams), np.float32)
    opaque = (cells > 0.5).astype(np.uint8)
    raycast.cast(opaque, laser / [0.1, 0.1, 1.0], LASER.angles, 500.0, False, ranges)
    stamps = np.arange(scans, dtype=np.int64) * 200_000_000
    return Log("room", Path("room.mcap"), "0" * 64, LASER, stamps, poses, ranges * np.float32(0.1), grid)


@pytest.mark.parametrize(("odometry", "init"), [("wheels", "free_space"), ("both", "exhaustive")])
def test_two_places_that_look_alike_are_never_averaged(odometry: str, init: str) -> None:
    """A blunt sensor model and many particles, so that neither place wins by the luck of the draw.

    Where the laser is heard, particles drive apart so little that few of those all over the room ever fit.
    """
    log = symmetric_room(40)
    blunt = {"independent_beams": 1.0, "sigma_hit": 0.3}
    config = Config(**PLAIN, init=init, max_particles=100_000, odometry=odometry, **blunt)
    here = log.odometry  # in the grid frame
    there = np.column_stack([8.0 - here[:, 0], 6.0 - here[:, 1], here[:, 2] + math.pi])
    for step in run(log, config)[8:]:
        places = log.grid.to_map(np.stack([here[step.index], there[step.index]]))
        chosen = []
        for hypothesis in step.clusters[:2]:
            off = [math.dist(hypothesis.pose[:2], place[:2]) for place in places]
            chosen.append(int(np.argmin(off)))
            assert min(off) < 0.25
            assert abs(wrap_angle(hypothesis.pose[2] - places[chosen[-1], 2])) < 0.2
        assert sorted(chosen) == [0, 1]
        assert step.clusters[1].weight > 0.2


def test_the_frame_of_the_map_does_not_matter() -> None:
    """The filter works in the grid's frame: wherever the map lies, it does the same, and says where in the map."""
    log = symmetric_room(25)
    moved = dataclasses.replace(log, grid=OccupancyGrid(log.grid.occupancy, 0.1, (-40.0, 7.0, -2.5)))
    config = Config(**PLAIN, init="free_space", max_particles=3000)
    for a, b in zip(run(log, config), run(moved, config), strict=True):
        np.testing.assert_array_equal(a.log_weights, b.log_weights)
        there = moved.grid.to_map(log.grid.to_grid(a.estimate.pose))
        np.testing.assert_allclose(there[:2], b.estimate.pose[:2], atol=1e-9)
        assert abs(wrap_angle(there[2] - b.estimate.pose[2])) < 1e-9
        assert a.spread == pytest.approx(b.spread)


# --- a robot that stands still ---------------------------------------------------------------------------------------


def standing(scan: Scan, index: int, offset=(0.0, 0.0, 0.0), ranges=None) -> Scan:
    odometry = compose(scan.odometry, offset)
    seen = scan.ranges if ranges is None else ranges
    return dataclasses.replace(scan, index=index, time=scan.time + 0.01 * index, odometry=odometry, ranges=seen)


def test_nothing_changes_while_the_robot_stands_still(office: Log) -> None:
    """As the wheels say, whatever the laser sees."""
    mcl = ParticleFilter(office.grid, office.laser, known_start(office, odometry="wheels"))
    scans = list(office.scans())[:15]
    for scan in scans:
        before = kept(mcl.update(scan))
    nothing = np.full_like(scans[-1].ranges, 1.0)  # somebody stands around the robot, and that does not matter
    for i in range(15, 25):
        step = mcl.update(standing(scans[-1], i, ranges=nothing))
        assert not step.moved
        assert not step.resampled
        np.testing.assert_array_equal(step.particles, before.particles)
        np.testing.assert_array_equal(step.log_weights, before.log_weights)
        np.testing.assert_allclose(step.estimate.pose, before.estimate.pose, atol=1e-12)
        assert (step.ess, step.spread) == pytest.approx((before.ess, before.spread))
    assert mcl.update(standing(scans[-1], 25, offset=(0.2, 0.0, 0.0))).moved


@pytest.mark.parametrize("odometry", ["both", "laser"])
def test_nothing_changes_while_the_laser_sees_that_the_robot_stands_still(office: Log, odometry: str) -> None:
    """Apart from the noise of the laser, by which the estimate may shift; the belief does not."""
    mcl = ParticleFilter(office.grid, office.laser, known_start(office, odometry=odometry))
    scans, rng = list(office.scans())[:15], np.random.default_rng(0)
    for scan in scans:
        before = kept(mcl.update(scan))
    for i in range(15, 25):
        noisy = (scans[-1].ranges + rng.normal(0.0, 0.01, len(scans[-1].ranges))).astype(np.float32)
        step = mcl.update(standing(scans[-1], i, ranges=noisy))
        assert not step.moved
        np.testing.assert_array_equal(step.particles, before.particles)
        np.testing.assert_allclose(step.estimate.pose, before.estimate.pose, atol=0.01)


def test_creeping_adds_up(office: Log) -> None:
    """Steps too short for an update are not forgotten: the estimate follows, and the tenth of a step updates."""
    config = known_start(office, odometry="wheels", update_min_d=0.05, update_min_a=0.05)
    mcl = ParticleFilter(office.grid, office.laser, config)
    scan = next(iter(office.scans()))
    start = mcl.update(scan).estimate.pose
    moved = []
    for i in range(1, 8):
        step = mcl.update(standing(scan, i, offset=(0.0101 * i, 0.0, 0.0)))
        moved.append(step.moved)
        if not step.moved and not any(moved):
            np.testing.assert_allclose(step.estimate.pose, compose(start, (0.0101 * i, 0.0, 0.0)), atol=1e-9)
    assert moved == [False, False, False, False, True, False, False]


# --- what a step says ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def tracked(office: Log) -> list[Step]:
    return run(office, known_start(office), 60)


def test_weights_sum_to_one(tracked: list[Step]) -> None:
    for step in tracked:
        weights = np.exp(step.log_weights)
        assert weights.sum() == pytest.approx(1.0, abs=1e-9)
        assert step.ess == pytest.approx(1 / np.sum(weights**2), rel=1e-6)
        assert 1.0 <= step.ess <= len(weights) * (1 + 1e-9)


def test_shapes_and_order(office: Log, tracked: list[Step]) -> None:
    for scan, step in zip(office.scans(), tracked, strict=False):
        assert (step.index, step.stamp, step.time) == (scan.index, scan.stamp, scan.time)
        assert step.particles.shape == (2000, 3)
        assert step.particles.dtype == np.float32
        assert step.log_weights.shape == (2000,)
        assert np.abs(step.particles[:, 2]).max() <= np.float32(math.pi)
        assert step.clusters[0] is step.estimate
        shares = [c.weight for c in step.clusters]
        assert shares == sorted(shares, reverse=True)
        assert 0 < sum(shares) <= 1 + 1e-9
        for cluster in step.clusters:
            assert np.linalg.eigvalsh(cluster.covariance).min() > -1e-9
        assert len(step.beams.angles) == len(step.beams.measured) == len(step.beams.expected)
        np.testing.assert_allclose(step.beams.laser, compose(step.estimate.pose, office.laser.pose))
        assert 0 <= step.explained <= 1


def test_spread_is_the_distance_of_the_particles_from_the_estimate(tracked: list[Step]) -> None:
    for step in tracked[::10]:
        off = step.particles[:, :2] - step.estimate.pose[:2]
        expected = math.sqrt(np.sum(np.exp(step.log_weights) * (off**2).sum(axis=1)))
        assert step.spread == pytest.approx(expected, rel=1e-3)


def test_expected_beams_are_those_of_the_map(office: Log, tracked: list[Step]) -> None:
    """At the right pose most beams end where the map says."""
    explained = [step.explained for step in tracked]
    assert np.median(explained) > 0.5
    for step in tracked[::10]:
        near = np.abs(step.beams.measured - step.beams.expected) < 0.3
        assert step.explained == pytest.approx(near[np.isfinite(step.beams.measured)].mean())


def test_arrays_of_a_step_are_read_only(office: Log) -> None:
    mcl = ParticleFilter(office.grid, office.laser, known_start(office))
    step = mcl.update(next(iter(office.scans())))
    with pytest.raises(ValueError, match="read-only"):
        step.particles[0, 0] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        step.log_weights[0] = 0.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        step.moved = False  # type: ignore[misc]


def test_the_course_resamples_at_every_update(office: Log) -> None:
    steps = run(office, known_start(office, resample_ess=1.0), 40)
    assert all(step.resampled == step.moved for step in steps[1:])
    assert not steps[0].resampled
    never = run(office, known_start(office, resample_ess=0.0), 40)
    assert not any(step.resampled for step in never)


# --- events ----------------------------------------------------------------------------------------------------------


def told(steps: list[Step]) -> list[tuple[int, str]]:
    return [(step.index, event.kind) for step in steps for event in step.events]


def test_started_once_and_converged(office: Log) -> None:
    events = told(run(office, known_start(office, initial_pose_std=(0.6, 0.6, 0.2)), 60))
    assert events[0] == (0, "started")
    kinds = [kind for _, kind in events]
    assert kinds.count("started") == 1
    assert kinds.count("converged") == 1
    assert (0, "converged") not in events


def kidnapped(log: Log, begin: int, carried: int, put_down: int, end: int) -> tuple[Log, np.ndarray]:
    """A log from scan ``begin``, whose robot is carried from one place of its way to another while its wheels stand
    still; and where it truly was, (n, 3)."""
    rows = np.r_[begin:carried, put_down:end]
    odometry = log.odometry.copy()
    odometry[put_down:] = compose(odometry[carried - 1], between(odometry[put_down], odometry[put_down:]))
    cut = dataclasses.replace(
        log, stamps=log.stamps[begin : begin + len(rows)], odometry=odometry[rows], ranges=log.ranges[rows]
    )
    return cut, log.ground_truth.poses[rows]


def test_resampling_at_every_third_update_only(office: Log) -> None:
    steps = [step for step in run(office, known_start(office, resample_interval=3, resample_ess=1.0), 40) if step.moved]
    assert [i for i, step in enumerate(steps) if step.resampled] == list(range(3, len(steps), 3))


def test_lost_and_found(office: Log) -> None:
    log, truth = kidnapped(office, 80, 110, 250, 300)
    start = {"initial_pose": tuple(truth[0].tolist()), "recovery": "search", "max_particles": 3000}
    steps = run(log, known_start(office, **start))
    events = told(steps)
    (lost,) = [i for i, kind in events if kind == "lost"]
    (found,) = [i for i, kind in events if kind == "found"]
    assert 30 <= lost <= found
    off = [math.dist(step.estimate.pose[:2], truth[step.index, :2]) for step in steps]
    assert max(off[:30]) < 0.3
    assert off[30] > 5.0
    assert max(off[found:]) < 0.3


def test_every_event_is_a_sentence(office: Log) -> None:
    for step in run(office, known_start(office), 120):
        for event in step.events:
            assert event.text[0].isupper()
            assert event.text.endswith(".")
            assert event.level in ("INFO", "WARN")


# --- what may go wrong -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("reading", [math.nan, math.inf, 0.0])
def test_scans_that_say_nothing(office: Log, reading: float) -> None:
    mcl = ParticleFilter(office.grid, office.laser, known_start(office))
    scans = list(office.scans())[:6]
    for scan in scans:
        step = mcl.update(dataclasses.replace(scan, ranges=np.full_like(scan.ranges, reading)))
        assert np.isfinite(step.estimate.pose).all()
        assert np.isfinite([step.ess, step.mean_likelihood, step.explained, step.spread]).all()
        assert np.exp(step.log_weights).sum() == pytest.approx(1.0)
        if math.isnan(reading):
            assert step.ess == pytest.approx(2000)  # nobody is any better than another


def test_all_particles_off_the_map(office: Log) -> None:
    """The odometry jumps out of the building: no pose explains anything, and the weights stay a distribution."""
    mcl = ParticleFilter(office.grid, office.laser, known_start(office))
    scan = next(iter(office.scans()))
    mcl.update(scan)
    step = mcl.update(standing(scan, 1, offset=(500.0, 0.0, 0.0)))
    assert np.exp(step.log_weights).sum() == pytest.approx(1.0)
    assert np.isfinite(step.estimate.pose).all()


@pytest.mark.parametrize("beams", [0, 179, 181])
def test_wrong_number_of_ranges(office: Log, beams: int) -> None:
    mcl = ParticleFilter(office.grid, office.laser, known_start(office))
    scan = dataclasses.replace(next(iter(office.scans())), ranges=np.ones(beams, np.float32))
    with pytest.raises(MclError, match=f"{beams} ranges"):
        mcl.update(scan)


@pytest.mark.parametrize(
    "init",
    ["free_space", "exhaustive"],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_no_free_cell(office: Log, init: str) -> None:
    with pytest.raises(MclError, match="no free cell"):
        run(office, Config(init=init, free_threshold=0.0, max_particles=100, min_particles=10), 1)


def test_a_pose_off_the_map(office: Log) -> None:
    with pytest.raises(MclError, match="not on the map"):
        run(office, known_start(office, initial_pose=(-5.0, 3.0, 0.0)), 1)


@pytest.mark.parametrize("caster", ["dda", "bresenham"])
def test_the_building_is_searched_whoever_casts_the_rays(office: Log, caster: str) -> None:
    steps = run(office, Config(init="exhaustive", ray_caster=caster, max_particles=300, adaptive="none"), 1)
    assert len(steps[0].particles) == 300
