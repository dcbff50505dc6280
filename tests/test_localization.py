"""The loop: every scan once, to every sink, and a result that says what the steps said."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.filter.step import Step
from pipeline.localization import localize
from pipeline.logs.messages import Log


class Keep:
    """A sink that keeps what it is shown."""

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self.particles: list[np.ndarray] = []

    def log(self, step: Step) -> None:
        self.steps.append(step)
        self.particles.append(step.particles.copy())


def shortened(log: Log, scans: int) -> Log:
    return dataclasses.replace(log, stamps=log.stamps[:scans], odometry=log.odometry[:scans], ranges=log.ranges[:scans])


def config(log: Log, **values) -> Config:
    start = {"init": "pose", "initial_pose": tuple(log.ground_truth.poses[0].tolist())}
    start |= {"initial_pose_std": (0.2, 0.2, 0.1)}
    plain = {"occupied_threshold": 0.65, "range_bias": 0.0, "recovery": "none"}
    return Config(**(start | plain | {"max_particles": 2000, "min_particles": 500} | values))


@pytest.fixture(scope="module")
def short(office: Log) -> Log:
    return shortened(office, 120)


def test_every_scan_once_to_every_sink_in_order(short: Log) -> None:
    first, second, seen = Keep(), Keep(), []

    def progress(scans):
        for scan in scans:
            seen.append(scan.index)
            yield scan

    result = localize(short, config(short), sinks=[first, second], progress=progress)
    assert seen == [step.index for step in first.steps] == [step.index for step in second.steps] == list(range(120))
    np.testing.assert_array_equal(result.stamps, short.stamps)
    assert [step.stamp for step in first.steps] == short.stamps.tolist()


def test_the_result_says_what_the_steps_said(short: Log) -> None:
    keep = Keep()
    result = localize(short, config(short), sinks=[keep])
    np.testing.assert_array_equal(result.poses, [step.estimate.pose for step in keep.steps])
    np.testing.assert_array_equal(result.covariances, [step.estimate.covariance for step in keep.steps])
    assert (np.linalg.eigvalsh(result.covariances)[:, 0] > 0.0).all()
    np.testing.assert_array_equal(result.particles, [len(p) for p in keep.particles])
    for name in ("ess", "mean_likelihood", "explained", "spread"):
        np.testing.assert_array_equal(getattr(result, name), [getattr(step, name) for step in keep.steps])
    told = [(step.index, step.time, event) for step in keep.steps for event in step.events]
    assert list(result.events) == told
    assert told[0][2].kind == "started"
    (converged,) = [time for _, time, event in told if event.kind == "converged"]
    assert result.converged_at == converged
    assert result.seconds
    assert all(seconds >= 0 for seconds in result.seconds.values())
    assert result.trajectory.frame == "map"
    np.testing.assert_array_equal(result.trajectory.stamps, short.stamps)


def test_where_the_robot_was(short: Log) -> None:
    result = localize(short, config(short))
    truth = short.ground_truth.poses[:120, :2]
    assert np.hypot(*(result.poses[:, :2] - truth).T).max() < 0.3
    assert result.hindsight is not None
    assert np.hypot(*(result.hindsight[:, :2] - truth).T).max() < 0.3
    assert localize(short, config(short, hindsight=False)).hindsight is None


def test_never_converged(short: Log) -> None:
    lost = shortened(short, 3)
    result = localize(lost, config(lost, init="free_space"))
    assert result.converged_at is None


def test_the_same_with_any_number_of_threads(short: Log) -> None:
    log = shortened(short, 40)
    start = config(log, init="free_space", max_particles=20_000)
    results = [localize(log, start, seed=3, threads=threads) for threads in (1, 2, None)]
    for other in results[1:]:
        for field in dataclasses.fields(other):
            if field.name not in ("seconds", "events", "seen"):
                a, b = (np.asarray(getattr(r, field.name)) for r in (results[0], other))
                assert a.tobytes() == b.tobytes(), field.name
        assert results[0].events == other.events
    assert localize(log, start, seed=4).poses.tobytes() != results[0].poses.tobytes()


def test_the_log_is_left_alone(short: Log) -> None:
    log = shortened(short, 10)
    before = log.ranges.copy(), log.odometry.copy()
    localize(log, config(log))
    np.testing.assert_array_equal(log.ranges, before[0])
    np.testing.assert_array_equal(log.odometry, before[1])


def test_a_sink_that_fails_ends_the_run(short: Log) -> None:
    class Full:
        def log(self, step: Step) -> None:
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        localize(shortened(short, 3), config(short), sinks=[Full()])


def test_no_map(short: Log) -> None:
    with pytest.raises(MclError, match=r"no map.*--map"):
        localize(dataclasses.replace(short, grid=None), config(short))


def test_no_scans(short: Log) -> None:
    with pytest.raises(MclError, match="no scans"):
        localize(shortened(short, 0), config(short))


def test_readings_up_to_the_shortest_range_say_nothing(short: Log) -> None:
    least = float(np.nanquantile(short.ranges[np.isfinite(short.ranges)], 0.3))
    cut = dataclasses.replace(short, ranges=np.where(short.ranges <= np.float32(least), np.nan, short.ranges))
    limited = localize(short, config(short, laser_min_range=least))
    np.testing.assert_array_equal(limited.poses, localize(cut, config(short)).poses)
    assert not np.array_equal(limited.poses, localize(short, config(short)).poses)


def test_no_range_is_longer_than_the_lasers_own(short: Log) -> None:
    """As in AMCL, whose own default is 100 m for any laser."""
    own = localize(short, config(short)).poses
    np.testing.assert_array_equal(localize(short, config(short, laser_max_range=1000.0)).poses, own)
    assert not np.array_equal(localize(short, config(short, laser_max_range=5.0)).poses, own)
