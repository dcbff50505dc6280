"""The beam model (Table 6.1): a density, in metres, with weights as they are; and its table of 256 codes."""

from __future__ import annotations

import math

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.config import Config, load_config
from pipeline.filter.beam_model import BeamModel, is_hit, mixture_density, no_return_mass, step_density
from pipeline.kernels.resampling import low_variance
from pipeline.maps.range_table import HIT_CODES, LOG_OFFSET, RangeCodes

# The four parts of the book, where nothing else is asked for.
BOOK = {"z_long": 0.0}
MAX_RANGE = 20.0


def twin(z: float, z_star: float, config: Config, max_range: float = MAX_RANGE) -> float:
    return reference.beam_density(
        z,
        z_star,
        max_range,
        hit=config.z_hit,
        short=config.z_short,
        rand=config.z_rand,
        sigma=config.sigma_hit,
        rate=config.lambda_short,
        long=config.z_long,
        long_rate=config.lambda_long,
    )


weights = st.floats(0.0, 20.0)
configs = st.builds(
    lambda hit, short, rand, sigma, rate: Config(
        z_hit=hit, z_short=short, z_rand=rand, sigma_hit=sigma, lambda_short=rate, **BOOK
    ),
    weights,
    weights,
    st.floats(0.01, 20.0),
    st.floats(0.02, 3.0),
    st.floats(0.05, 3.0),
)


@given(configs, st.floats(0.0, MAX_RANGE), st.one_of(st.floats(0.05, MAX_RANGE), st.just(math.inf)))
@settings(deadline=None)
def test_density_is_that_of_the_book(config: Config, z: float, z_star: float) -> None:
    assert mixture_density(z, z_star, config, MAX_RANGE) == pytest.approx(twin(z, z_star, config), rel=1e-6)


def test_density_broadcasts() -> None:
    z, z_star = np.linspace(0.1, 19, 7), np.array([0.5, 4.0, 15.0, np.inf])
    table = mixture_density(z[:, None], z_star[None, :], Config(), MAX_RANGE)
    assert table.shape == (7, 4)
    for i, j in np.ndindex(7, 4):
        assert table[i, j] == pytest.approx(twin(z[i], z_star[j], Config()), rel=1e-9)


def integral(z_star: float, config: Config, max_range: float = MAX_RANGE) -> float:
    """By the midpoint rule on both sides of z*, where parts of the density begin and end."""
    edge = min(z_star, max_range)
    total = 0.0
    for low, high in ((0.0, edge), (edge, max_range)):
        n = 200_000
        z = low + (np.arange(n) + 0.5) * (high - low) / n
        total += float(mixture_density(z, z_star, config, max_range).mean()) * (high - low)
    return total


@pytest.mark.parametrize("z_star", [0.1, 0.5, 4.0, 13.0, 19.5])
@pytest.mark.parametrize("parts", [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0.6, 0.1, 0.25, 0.05), (12, 1, 8000, 1)])
def test_parts_integrate_to_their_weights(z_star: float, parts) -> None:
    """Also close to both ends of the range, where part of the Gaussian would lie outside."""
    z_hit, z_short, z_rand, z_max = parts
    config = Config(z_hit=z_hit, z_short=z_short, z_rand=z_rand, z_max=z_max, sigma_hit=0.4, lambda_short=0.7, **BOOK)
    density = integral(z_star, config)
    assert density == pytest.approx(z_hit + z_short + z_rand, rel=1e-5)
    assert density + float(no_return_mass(z_star, config)) == pytest.approx(sum(parts), rel=1e-5)


def test_without_an_obstacle_the_hit_is_a_missing_return() -> None:
    config = Config(z_hit=0.6, z_short=0.1, z_rand=0.25, z_max=0.05, **BOOK)
    assert integral(math.inf, config) == pytest.approx(0.35, rel=1e-5)
    assert integral(math.inf, config) + float(no_return_mass(math.inf, config)) == pytest.approx(1.0, rel=1e-5)


@pytest.mark.parametrize("z_star", [0.1, 4.0, 19.5])
def test_readings_beyond_the_wall_have_their_own_mass(z_star: float) -> None:
    config = Config(z_hit=0.5, z_short=0.1, z_rand=0.1, z_max=0.05, z_long=0.25)
    assert integral(z_star, config) + float(no_return_mass(z_star, config)) == pytest.approx(1.0, rel=1e-5)
    alone = Config(z_hit=0, z_short=0, z_rand=1, z_max=0, z_long=1.0)
    z = np.array([z_star - 0.05, z_star + 0.01, z_star + 0.3])
    short, near, far = mixture_density(z, z_star, alone, MAX_RANGE)
    assert short == pytest.approx(1 / MAX_RANGE)
    assert near > far > short
    for reading in z:
        assert mixture_density(reading, z_star, alone, MAX_RANGE) == pytest.approx(twin(reading, z_star, alone))


# --- the table that the kernels read ---------------------------------------------------------------------------------


def model(config: Config, max_range: float = MAX_RANGE) -> BeamModel:
    return BeamModel(config, RangeCodes(max_range), max_range)


def rows_of(ranges, config: Config, max_range: float = MAX_RANGE) -> np.ndarray:
    m = model(config, max_range)
    return m.scan_rows(m.correct(np.asarray(ranges, np.float32), 0.0))


def differences(config: Config, max_range: float, far: float) -> np.ndarray:
    """Of readings about true ranges up to ``far`` metres: log-likelihood from the table less the exact one."""
    codes, rng, n = RangeCodes(max_range), np.random.default_rng(1), 5000
    star = rng.uniform(0.02, far, n)
    z = np.clip(star + rng.normal(0, 3 * config.sigma_hit, n), 0.02, 0.76 * max_range)
    scale = np.log1p(codes.ranges[:HIT_CODES] / LOG_OFFSET)
    nearest = np.abs(scale[None] - np.log1p(star / LOG_OFFSET)[:, None]).argmin(axis=1)
    rows = rows_of(z, config, max_range)[np.arange(n), nearest]
    return np.abs(rows - np.log(mixture_density(z, star, config, max_range)))


@pytest.mark.parametrize(("far", "worst", "mean"), [(3.0, 0.9, 0.1), (10.0, 2.0, 0.22), (30.0, 5.0, 0.6)])
def test_quantised_log_likelihood_of_a_sharp_model(far: float, worst: float, mean: float) -> None:
    """In nats of one beam of a laser that sees 82 m: eight bits are as fine as sigma = 15 cm near the robot, and half
    a step is 25 cm at 30 m, on the flank of the Gaussian."""
    found = differences(Config(sigma_hit=0.15), 82.0, far)
    assert found.max() < worst
    assert found.mean() < mean


def test_quantised_log_likelihood_of_the_course_is_all_but_exact() -> None:
    """Its Gaussian is 2 m wide; what is left is the end of the short readings at z*, which may fall into a step."""
    found = differences(load_config("course"), 81.91, 60.0)
    assert found.max() < 0.2
    assert found.mean() < 0.001


def too_low(config: Config, far: float, max_range: float = 82.0) -> tuple[np.ndarray, np.ndarray]:
    """By how much the table, and a table of the density at each code's own range, take hits for less likely than they
    are, in nats: readings drawn from the Gaussian about true ranges up to ``far`` metres."""
    codes, rng, n = RangeCodes(max_range), np.random.default_rng(1), 20_000
    star = rng.uniform(0.02, far, n)
    z = np.clip(star + rng.normal(0, config.sigma_hit, n), 0.02, 0.76 * max_range)
    code = np.searchsorted(codes.steps[1][:HIT_CODES], star)
    exact = np.log(mixture_density(z, star, config, max_range))
    at_code = np.log(mixture_density(z, codes.ranges[code], config, max_range))
    return exact - rows_of(z, config, max_range)[np.arange(n), code], exact - at_code


@pytest.mark.parametrize(
    ("sigma", "far", "before", "now"),
    [(0.05, 10.0, 4.5, 2.6), (0.05, 30.0, 8.0, 3.4), (0.15, 10.0, 1.5, 1.2), (0.15, 30.0, 3.9, 2.2)],
)
def test_a_hit_whose_step_is_wide_is_not_taken_for_a_miss(sigma: float, far: float, before: float, now: float) -> None:
    """Averaged over the step of z*, a right beam loses half as much at worst, and not more in the mean where steps
    are wide. The price: a beam that just misses gains as much as the other lost, so the largest difference stays."""
    averaged, at_code = too_low(Config(sigma_hit=sigma), far)
    assert at_code.max() > before
    assert averaged.max() < now
    assert averaged.mean() < 1.1 * at_code.mean()


TO_AVERAGE = [
    Config(),
    Config(sigma_hit=0.03, lambda_short=10.0, lambda_long=20.0),
    Config(z_hit=1.0, z_short=0.0, z_long=0.0, z_rand=0.1),
    Config(z_hit=0.0, z_short=1.0, z_long=1.0, z_rand=0.1),
    load_config("course"),
]


@pytest.mark.parametrize("config", TO_AVERAGE)
def test_the_density_of_a_step_is_the_mean_over_it(config: Config) -> None:
    low, high = (border[:HIT_CODES] for border in RangeCodes(MAX_RANGE).steps)
    z = np.linspace(0.05, 18.0, 150)
    shares = (np.arange(500) + 0.5) / 500
    mean = np.mean([mixture_density(z[:, None], low + s * (high - low), config, MAX_RANGE) for s in shares], axis=0)
    np.testing.assert_allclose(step_density(z, low, high, config, MAX_RANGE), mean, rtol=0.04, atol=1e-4)


def test_a_narrow_step_has_the_density_itself() -> None:
    z, star = np.linspace(0.05, 19.5, 200), np.linspace(0.3, 19.0, 30)
    exact = mixture_density(z[:, None], star, Config(), MAX_RANGE)
    np.testing.assert_allclose(step_density(z, star - 1e-5, star + 1e-5, Config(), MAX_RANGE), exact, rtol=1e-3)


def test_where_nothing_ends_the_ray_there_is_no_step() -> None:
    z = np.linspace(0.05, 19.5, 20)
    (column,) = step_density(z, np.array([np.inf]), np.array([np.inf]), Config(), MAX_RANGE).T
    np.testing.assert_allclose(column, mixture_density(z, np.inf, Config(), MAX_RANGE))


def test_scan_rows_hold_what_the_density_says() -> None:
    """Only the step of z is left: 2.4 mm here."""
    config, codes = Config(sigma_hit=0.3), RangeCodes(MAX_RANGE)
    z = np.linspace(0.05, 19.9, 300)
    rows = rows_of(z, config)
    assert rows.shape == (300, 256)
    assert rows.dtype == np.float32
    assert np.abs(rows - np.log(step_density(z, *codes.steps, config, MAX_RANGE))).max() < 0.15


def test_unnormalised_weights_give_the_same_particle_weights() -> None:
    parts = {"z_hit": 0.6, "z_short": 0.1, "z_max": 0.05, "z_rand": 0.2, "z_long": 0.05}
    ranges = np.array([0.5, 3.0, 8.0, np.inf, np.nan, 19.0], np.float32)
    codes = np.random.default_rng(0).integers(0, 256, (500, 6))
    results = []
    for factor in (1.0, 1 / 7, 8012.0):
        config = Config(**{k: v * factor for k, v in parts.items()})
        log = rows_of(ranges, config)[np.arange(6), codes].astype(float).sum(axis=1)
        m = model(config)
        log = np.append(log, m.outside(m.correct(ranges, 0.0)))  # and one that stands in a wall
        results.append(np.exp(log - np.logaddexp.reduce(log)))
    np.testing.assert_allclose(results[1], results[0], rtol=1e-4, atol=1e-12)
    np.testing.assert_allclose(results[2], results[0], rtol=1e-4, atol=1e-12)


def test_invalid_readings_say_nothing() -> None:
    rows = rows_of([np.nan, 3.0], Config())
    assert not rows[0].any()
    assert rows[1].any()
    m = model(Config())
    some = m.correct(np.array([3.0, 4.0], np.float32), 0.0)
    with_invalid = m.correct(np.array([3.0, np.nan, 4.0, np.nan], np.float32), 0.0)
    assert m.outside(with_invalid) == m.outside(some)  # nor of a pose in a wall


def test_a_pose_in_a_wall_is_worse_than_one_that_explains_the_scan() -> None:
    config = Config()
    m = model(config)
    seen = m.correct(np.array([2.0, 3.0, 5.0], np.float32), 0.0)
    codes = [int(np.abs(RangeCodes(MAX_RANGE).ranges[:HIT_CODES] - z).argmin()) for z in seen]
    assert m.outside(seen) < float(m.scan_rows(seen)[np.arange(3), codes].sum()) - 3.0


def test_no_return_threshold() -> None:
    config = Config(no_return_fraction=0.77, **BOOK)
    m = model(config)
    limit = 0.77 * MAX_RANGE
    seen = m.correct(np.array([limit - 0.01, limit + 0.01, MAX_RANGE, np.inf, np.nan], np.float32), 0.0)
    assert seen[0] == pytest.approx(limit - 0.01, abs=1e-5)
    assert np.isinf(seen[1:4]).all()
    assert np.isnan(seen[4])
    rows = m.scan_rows(seen)
    np.testing.assert_array_equal(rows[1], rows[3])
    # Where an obstacle stops the ray, a missing return has z_max's mass whatever the range; beyond the map z_hit's too.
    np.testing.assert_allclose(rows[3, :HIT_CODES], math.log(config.z_max), rtol=1e-6)
    assert rows[3, 255] == pytest.approx(math.log(config.z_max + config.z_hit), rel=1e-6)


def test_range_bias_is_taken_off() -> None:
    m = model(Config())
    ranges = np.array([3.0, 0.05, np.inf, np.nan], np.float32)
    seen = m.correct(ranges, 0.12)
    np.testing.assert_allclose(seen[:2], [2.88, 0.0], atol=1e-6)
    assert np.isinf(seen[2])
    assert np.isnan(seen[3])
    assert ranges[0] == 3.0  # the scan itself is left alone


# --- the course's report ---------------------------------------------------------------------------------------------


def report_density_cm(z: float, z_star: float) -> float:
    """The report's mixture in its own unit, centimetres: z_hit 12, z_short 1, z_rand 8000, sigma 200, lambda 0.002."""
    return reference.beam_density(z, z_star, 8191.0, hit=12, short=1, rand=8000, sigma=200.0, rate=0.002)


def test_the_course_preset_is_the_report_in_metres() -> None:
    config = load_config("course")
    assert config.laser_max_range == 81.91
    for z_cm in (10.0, 250.0, 900.0, 3000.0, 6000.0):
        for star_cm in (50.0, 300.0, 1000.0, 4500.0, 8000.0):
            here = float(mixture_density(z_cm / 100, star_cm / 100, config, 81.91))
            assert here == pytest.approx(100 * report_density_cm(z_cm, star_cm), rel=1e-9)
    # The mass of a missing return keeps its proportion to the densities: 0.01 beside densities per centimetre.
    assert float(no_return_mass(12.0, config)) == pytest.approx(100 * 0.01)
    assert model(config).temper(np.full(36, 3.0, np.float32)) == 1.0  # the report multiplies the beams as they are


def test_the_course_preset_takes_readings_beyond_77_percent_for_missing() -> None:
    m = model(load_config("course"), 81.91)
    seen = m.correct(np.array([63.06, 63.08], np.float32), 0.0)  # the report's threshold: 6307 cm
    assert np.isfinite(seen[0])
    assert np.isinf(seen[1])


def test_the_course_preset_ranks_particles_as_the_report_does() -> None:
    """Three beams of which one has no return, at twenty places, in centimetres and through the metres' table."""
    rng = np.random.default_rng(4)
    codes = RangeCodes(81.91)
    at = rng.integers(20, HIT_CODES - 20, (20, 3))
    stars = codes.ranges[at]
    readings = np.array([4.0, np.inf, 17.3], np.float32)
    in_cm = [
        math.log(report_density_cm(400.0, 100 * a)) + math.log(0.01) + math.log(report_density_cm(1730.0, 100 * c))
        for a, _, c in stars
    ]
    in_metres = rows_of(readings, load_config("course"), 81.91)[np.arange(3), at].sum(axis=1)
    weights = [np.exp(np.array(log, float) - np.logaddexp.reduce(np.array(log, float))) for log in (in_cm, in_metres)]
    np.testing.assert_allclose(weights[1], weights[0], rtol=0.01)
    ancestors = [np.empty(20, np.int32), np.empty(20, np.int32)]
    for w, out in zip(weights, ancestors, strict=True):
        low_variance(0, w, 0.37, np.empty(2), out)
    np.testing.assert_array_equal(*ancestors)


def test_what_counts_as_a_hit() -> None:
    """Near the map's range: as far as the Gaussian outweighs all else. Never where the map ends no ray."""
    config = Config()
    z = np.linspace(0.0, 12.0, 2401)
    hits = z[is_hit(z, 6.0, config, 80.0)]
    for far in (6.0 - hits.min(), hits.max() - 6.0):
        assert config.sigma_hit < far < 5 * config.sigma_hit
    assert (np.diff(hits) < 0.006).all(), "in one piece"
    assert not is_hit(z, np.inf, config, 80.0).any()
    assert not is_hit(z, 6.0, Config(z_hit=0.0), 80.0).any()
