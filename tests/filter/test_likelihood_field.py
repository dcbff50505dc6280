"""Likelihood fields: the book's (Table 6.3), AMCL's two, and beams that are skipped."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.config import Config
from pipeline.filter.likelihood_field import LikelihoodField, field_likelihood
from pipeline.filter.particle_filter import ParticleFilter
from pipeline.filter.sensor import Sensor
from pipeline.kernels.threads import use_threads
from pipeline.logs.messages import Laser, Log
from pipeline.maps.occupancy_grid import OccupancyGrid

FIELDS = ("likelihood_field", "likelihood_field_prob", "likelihood_field_cubes")
RESOLUTION, MAX_RANGE, MAX_DIST = 0.1, 8.0, 2.0
LASER = Laser((0.25, -0.05, 0.1), -math.pi / 2, math.pi / 2, 13, 0.0, MAX_RANGE)


def room() -> OccupancyGrid:
    """4 by 3 m with walls, a pillar and a corner that nobody has seen."""
    occupancy = np.zeros((30, 40), np.float32)
    occupancy[[0, -1]] = occupancy[:, [0, -1]] = 1.0
    occupancy[12:15, 20:22] = 0.9
    occupancy[20:, 30:] = np.nan
    return OccupancyGrid(occupancy, RESOLUTION)


@functools.cache
def room_distances() -> np.ndarray:
    return reference.nearest_obstacle(room().occupied(0.65), RESOLUTION, MAX_DIST)


def config(model: str, **values) -> Config:
    return Config(**{"sensor_model": model, "occupied_threshold": 0.65, "range_bias": 0.0} | values)


def model(model_type: str, **values) -> LikelihoodField:
    return LikelihoodField(room(), LASER, LASER.angles, config(model_type, **values), MAX_RANGE)


def scores(field: LikelihoodField, poses, ranges) -> np.ndarray:
    poses = np.ascontiguousarray(np.asarray(poses, np.float32).T)
    out = np.empty(poses.shape[1], np.float32)
    field.score(poses, field.read(np.asarray(ranges, np.float32)), out)
    return out


def some_poses(n: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform([-0.3, -0.3, -math.pi], [4.3, 3.3, math.pi], (n, 3)).astype(np.float32)


def some_ranges(seed: int = 0) -> np.ndarray:
    """Also a reading that is missing and one that is no number."""
    ranges = np.random.default_rng(seed).uniform(0.1, 4.0, LASER.beams).astype(np.float32)
    ranges[3], ranges[7] = np.inf, np.nan
    return ranges


def twin(pose, ranges, settings: Config) -> tuple[list[float], bool]:
    """p(z) of every beam that came back, by the twin; and whether single precision leaves its cell in doubt."""
    ends = reference.beam_ends(pose, LASER.pose, LASER.angles, ranges)
    cells = np.array(ends) / RESOLUTION
    doubt = bool(np.abs(cells - np.round(cells)).min() < 1e-4)
    weights = {"hit": settings.z_hit, "rand": settings.z_rand, "sigma": settings.sigma_hit}
    amcl = settings.sensor_model != "likelihood_field"
    found = reference.end_distances(ends, room_distances(), RESOLUTION, MAX_DIST)
    return [reference.field_density(d, MAX_RANGE, **weights, amcl=amcl) for d in found], doubt


@given(st.sampled_from(FIELDS), st.floats(0.0, 3.0), st.floats(0.0, 20.0), st.floats(0.0, 20.0), st.floats(0.02, 3.0))
def test_the_likelihood_of_a_distance(name: str, distance: float, hit: float, rand: float, sigma: float) -> None:
    values = config(name, z_hit=hit, z_rand=rand, sigma_hit=sigma)
    expected = reference.field_density(
        distance, MAX_RANGE, hit=hit, rand=rand, sigma=sigma, amcl=name != "likelihood_field"
    )
    assert field_likelihood(distance, values, MAX_RANGE) == pytest.approx(expected, rel=1e-9, abs=1e-300)


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("seed", range(2))
def test_scores_are_those_of_the_table(name: str, seed: int) -> None:
    """Products of Table 6.3 and of AMCL's likelihood_field_prob; 1 + sum of cubes of AMCL's likelihood_field."""
    poses, ranges, settings_ = some_poses(40, seed), some_ranges(seed), config(name)
    decided = 0
    for score, pose in zip(scores(model(name), poses, ranges), poses, strict=True):
        p, doubt = twin(pose, ranges, settings_)
        assert len(p) == LASER.beams - 2
        if not doubt:
            decided += 1
            cubes = name == "likelihood_field_cubes"
            expected = math.log(1.0 + sum(q**3 for q in p)) if cubes else sum(math.log(q) for q in p)
            assert score == pytest.approx(expected, abs=1e-3)
    assert decided > 30


def test_missing_readings_change_nothing() -> None:
    poses, ranges = some_poses(20), some_ranges()
    alone = dataclasses.replace(LASER, beams=1, angle_min=float(LASER.angles[0]))
    for name in FIELDS:
        field = LikelihoodField(room(), alone, LASER.angles[:1], config(name), MAX_RANGE)
        only = np.full(LASER.beams, np.inf, np.float32)
        only[0], only[5] = ranges[0], np.nan
        np.testing.assert_array_equal(scores(model(name), poses, only), scores(field, poses, ranges[:1]))
        assert not scores(model(name), poses, np.full(LASER.beams, np.nan)).any()


def test_nothing_is_impossible() -> None:
    """Where no reading is random, an end far from everything is as unlikely as single precision can say."""
    far = scores(model("likelihood_field", z_rand=0.0, sigma_hit=0.02), [(50.0, 50.0, 0.0)], some_ranges())
    assert np.isfinite(far).all()


def test_temper() -> None:
    assert model("likelihood_field", independent_beams=4.0).temper(16) == 0.25
    assert model("likelihood_field_prob", independent_beams=4.0).temper(2) == 1.0
    assert model("likelihood_field", independent_beams=None).temper(16) == 1.0
    assert model("likelihood_field").temper(0) == 1.0
    assert model("likelihood_field_cubes", independent_beams=4.0).temper(16) == 1.0


# --- skipped beams ---------------------------------------------------------------------------------------------------

AT = (1.05, 1.05, 0.0)
SKIP = {"do_beamskip": True}


def together(n: int = 300, spread: float = 0.03) -> np.ndarray:
    noise = np.random.default_rng(1).uniform(-spread, spread, (n, 3))
    return (np.array(AT) + noise).astype(np.float32)


def true_ranges() -> np.ndarray:
    """What the laser sees from ``AT``."""
    x, y = AT[0] + LASER.pose[0], AT[1] + LASER.pose[1]
    opaque = room().occupied(0.65)
    rays = [reference.ray(opaque, x / RESOLUTION, y / RESOLUTION, LASER.pose[2] + a, 100.0)[0] for a in LASER.angles]
    return np.array(rays) * RESOLUTION + 0.02


def interrupted() -> np.ndarray:
    """... and with somebody in the way of five beams, far from any wall."""
    ranges = true_ranges()
    ranges[5:8] = 0.15
    return ranges


def test_beams_that_end_on_a_passer_by_are_skipped() -> None:
    skipping, field = model("likelihood_field_prob", **SKIP), model("likelihood_field_prob")
    poses, ranges = together(), interrupted()
    ends = skipping.read(ranges.astype(np.float32))
    used = skipping.agreed(np.ascontiguousarray(poses.T), ends)
    ended = [reference.beam_ends(p, LASER.pose, LASER.angles, ranges) for p in poses]
    seen = np.array([reference.end_distances(e, room_distances(), RESOLUTION, np.inf) for e in ended])
    assert used.tolist() == reference.used_beams(seen, 0.5, 0.3, 0.9)
    assert np.flatnonzero(~used).tolist() == [5, 6, 7]
    # The weights are those of a scan without these beams; each of them counts as unexplained, the same for all.
    without = ranges.copy()
    without[5:8] = np.inf
    floor = math.log(field_likelihood(MAX_DIST, config("likelihood_field_prob"), MAX_RANGE))
    np.testing.assert_allclose(
        scores(skipping, poses, ranges), scores(field, poses, without) + 3 * floor, rtol=1e-5, atol=1e-3
    )


def test_nothing_is_skipped_before_the_particles_are_together() -> None:
    skipping, field = model("likelihood_field_prob", **SKIP), model("likelihood_field_prob")
    poses, ranges = np.vstack([together(), np.array([[1.8, 1.05, 0.0]], np.float32)]), interrupted()
    np.testing.assert_array_equal(scores(skipping, poses, ranges), scores(field, poses, ranges))


def test_when_nearly_every_beam_would_be_skipped_none_is() -> None:
    skipping = model("likelihood_field_prob", **SKIP, beam_skip_distance=0.15)
    ranges = np.full(LASER.beams, 0.15, np.float32)
    ranges[6] = true_ranges()[6]
    poses = np.ascontiguousarray(together().T)
    assert skipping.agreed(poses, skipping.read(ranges)).all()  # 12 of 13 is more than nine tenths
    late = model("likelihood_field_prob", **SKIP, beam_skip_distance=0.15, beam_skip_error_threshold=0.95)
    assert late.agreed(poses, late.read(ranges)).sum() == 1


@pytest.mark.parametrize("name", ["likelihood_field", "likelihood_field_cubes"])
def test_only_amcls_prob_skips_beams(name: str) -> None:
    poses, ranges = together(), interrupted()
    np.testing.assert_array_equal(scores(model(name, **SKIP), poses, ranges), scores(model(name), poses, ranges))


@given(st.integers(0, 10_000), st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
@settings(deadline=None, max_examples=40)
def test_agreed_is_amcls(seed: int, distance: float, threshold: float, error: float) -> None:
    names = ("beam_skip_distance", "beam_skip_threshold", "beam_skip_error_threshold")
    field = model("likelihood_field_prob", **SKIP, **dict(zip(names, (distance, threshold, error), strict=True)))
    poses, ranges = some_poses(20, seed), some_ranges(seed)
    ends = [reference.beam_ends(p, LASER.pose, LASER.angles, ranges) for p in poses]
    cells = np.array(ends) / RESOLUTION
    if np.abs(cells - np.round(cells)).min() < 1e-4:
        return
    seen = np.array([reference.end_distances(e, room_distances(), RESOLUTION, np.inf) for e in ends])
    found = field.agreed(np.ascontiguousarray(poses.T), field.read(ranges))
    assert found.tolist() == reference.used_beams(seen, distance, threshold, error)


# --- in the filter ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FIELDS)
def test_the_range_bias_is_taken_off(office: Log, name: str) -> None:
    """Readings that are too long by as much as the bias are scored like true ones."""
    scan = next(iter(office.scans()))
    longer = dataclasses.replace(scan, ranges=scan.ranges + np.float32(0.25))
    plain, biased = (Sensor(office.grid, office.laser, config(name, range_bias=b)) for b in (0.0, 0.25))
    np.testing.assert_allclose(plain.read(scan.ranges).seen, biased.read(longer.ranges).seen, atol=1e-3)


@pytest.mark.parametrize("name", [*FIELDS, "likelihood_field_prob, skipping"])
def test_every_model_tracks_a_known_start(office: Log, name: str) -> None:
    name, _, skipping = name.partition(", ")
    start = tuple(office.ground_truth.poses[0].tolist())
    values = {"init": "pose", "initial_pose": start, "initial_pose_std": (0.2, 0.2, 0.1), "recovery": "none"}
    settings_ = config(name, max_particles=2000, hindsight=False, do_beamskip=bool(skipping), **values)
    mcl = ParticleFilter(office.grid, office.laser, settings_, seed=1)
    errors = []
    for scan, truth in zip(list(office.scans())[:150], office.ground_truth.poses, strict=False):
        errors.append(math.dist(mcl.update(scan).estimate.pose[:2], truth[:2]))
    assert np.median(errors[20:]) < 0.3


def test_a_search_proposes_and_the_field_weighs(office: Log) -> None:
    """The exhaustive start and the challengers of the recovery run with a field, on any number of threads."""
    steps = []
    for threads in (1, 2):
        with use_threads(threads):
            settings_ = config("likelihood_field_prob", do_beamskip=True, max_particles=12_000)
            mcl = ParticleFilter(office.grid, office.laser, settings_, seed=5)
            steps.append([mcl.update(scan).estimate.pose.tobytes() for scan in list(office.scans())[:25]])
    assert steps[0] == steps[1]
