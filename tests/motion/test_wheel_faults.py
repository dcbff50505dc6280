"""Faults of the wheels are named from what the laser sees, and mended where they can be."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from priors import prior_of

from pipeline.config import Config
from pipeline.geometry import between, compose, wrap_angle
from pipeline.logs.leaps import FASTEST, SPINNING, leapt
from pipeline.logs.messages import Log
from pipeline.motion.faults import Fault, Faults, Step, without_leaps
from pipeline.motion.witnesses import Motion, Witnesses

SECONDS = 0.2


def drive(n: int, seed: int = 0) -> np.ndarray:
    """(n, 3) true steps: forwards at 0.5 m/s, in turns to either side, every third stretch backwards."""
    rng = np.random.default_rng(seed)
    steps = np.zeros((n, 3))
    for first in range(0, n, 40):
        steps[first : first + 40, 0] = -0.1 if first % 120 == 80 else 0.1
        steps[first + 5 : first + 20, 2] = rng.choice([-1.0, 1.0]) * 0.1
    return steps


def named(seen: np.ndarray, told: np.ndarray) -> tuple[list[Fault], Faults]:
    """What is named on the way, with the laser's noise of some millimetres and tenths of a degree."""
    faults, found = Faults(), list[Fault]()
    noise = np.random.default_rng(1).normal(0.0, [0.005, 0.005, 0.003], seen.shape)
    for k in range(len(seen)):
        found += faults.update(Step(SECONDS * (k + 1), SECONDS, told[k], seen[k] + noise[k]))
    return found, faults


def late(steps: np.ndarray, scans: int) -> np.ndarray:
    return np.vstack([np.zeros((scans, 3)), steps[:-scans]])


WRONG = {
    "dead": lambda s: s * 0.0,
    "mirrored": lambda s: s * [1.0, -1.0, -1.0],
    "no_reverse": lambda s: np.column_stack([np.abs(s[:, 0]), s[:, 1:]]),
    "scale": lambda s: s * [0.7, 0.7, 1.0],
    "late": lambda s: late(s, 2),
    "turned": lambda s: compose((0.0, 0.0, 2.0), compose(s, (0.0, 0.0, -2.0))),
}


@pytest.mark.parametrize("seed", range(3))
def test_sound_wheels_have_no_fault(seed: int) -> None:
    true = drive(600, seed)
    told = true * [1.03, 1.0, 0.97] + np.random.default_rng(seed).normal(0.0, [0.01, 0.0, 0.01], true.shape)
    found, faults = named(true, told)
    assert found == []
    np.testing.assert_array_equal(faults.mended(told[0]), told[0])


@pytest.mark.parametrize("kind", WRONG)
@pytest.mark.parametrize("seed", range(3))
def test_a_lasting_fault_is_named_once_and_no_other(kind: str, seed: int) -> None:
    true = drive(600, seed)
    found, _ = named(true, WRONG[kind](true))
    assert [fault.kind for fault in found] == [kind]


def test_numbers_are_told() -> None:
    true = drive(600)
    (scale,) = named(true, WRONG["scale"](true))[0]
    assert any(f"{metres} m for every metre" in scale.text for metres in ("0.69", "0.70", "0.71"))
    (lag,) = named(true, WRONG["late"](true))[0]
    assert "0.40 +- 0.0" in lag.text
    assert "behind the laser" in lag.text
    assert "115 deg right of where the wheels say" in named(true, WRONG["turned"](true))[0][0].text


@pytest.mark.parametrize("kind", ["mirrored", "scale"])
def test_what_can_be_mended_is(kind: str) -> None:
    true = drive(600)
    told = WRONG[kind](true)
    _, faults = named(true, told)
    mended = np.array([faults.mended(step) for step in told])
    np.testing.assert_allclose(mended, true, atol=0.003)


def test_wheels_that_come_to_life_are_heard_again() -> None:
    true = drive(400)
    told = true.copy()
    told[100:200] = 0.0
    found, faults = named(true, told)
    assert [fault.kind for fault in found] == ["dead"]
    assert not faults.dead


@pytest.mark.parametrize("slip", [(0.0, 0.0, 0.6), (0.0, 0.0, -2.0), (0.5, 0.0, 0.0), (-1.0, 2.0, 0.0)])
def test_a_slip_is_named_when_it_happens(slip: tuple[float, float, float]) -> None:
    true = drive(300)
    told = true.copy()
    told[150] = compose(told[150], slip)
    found, _ = named(true, told)
    assert [fault.kind for fault in found] == ["slipped"]
    assert f"at {SECONDS * 151:.1f} s" in found[0].text


def test_wheels_that_spin_for_two_seconds() -> None:
    true = drive(300)
    told = true.copy()
    told[145:155, 0] += 0.1
    found, _ = named(true, told)
    assert [fault.kind for fault in found] == ["slipped"]


def test_wheels_that_die_in_mid_drive_have_not_slipped_before() -> None:
    true = drive(400)
    told = true.copy()
    told[163:] = 0.0
    found, _ = named(true, told)
    assert [fault.kind for fault in found] == ["dead"]


def test_a_robot_that_is_pushed_while_its_wheels_stand_is_told_when_they_turn_again() -> None:
    true = drive(400)
    told = true.copy()
    true[202:214], told[202:214] = [0.1, 0.0, 0.0], 0.0
    found, _ = named(true, told)
    assert [fault.kind for fault in found] == ["slipped"]


def test_a_laser_that_cannot_say_teaches_nothing() -> None:
    faults = Faults()
    for k in range(300):
        assert faults.update(Step(SECONDS * k, SECONDS, np.array([0.1, 0.0, 0.1]), None)) == []


def test_no_robot_leaps() -> None:
    assert not leapt(np.array([FASTEST * 0.2 + 0.4, 0.0, 0.0]), 0.2)
    assert leapt(np.array([0.0, -FASTEST * 0.2 - 0.6, 0.0]), 0.2)
    assert not leapt(np.array([0.0, 0.0, SPINNING * 0.2]), 0.2)
    assert leapt(np.array([0.0, 0.0, -3.0]), 0.2)


# --- in a log --------------------------------------------------------------------------------------------------------


def heard(log: Log) -> list[Motion]:
    witnesses = Witnesses(log.laser, Config())
    return [witnesses.update(scan) for scan in log.scans()]


def kinds(motions: list[Motion]) -> list[str]:
    return [fault.kind for motion in motions for fault in motion.faults]


def spoiled(log: Log, wrong) -> Log:
    steps = wrong(between(log.odometry[:-1], log.odometry[1:]))
    odometry = [log.odometry[0]]
    for step in steps:
        odometry.append(compose(odometry[-1], step))
    return dataclasses.replace(log, odometry=np.array(odometry), sweeps=None)


def test_the_embedded_drive_has_none(office: Log) -> None:
    assert kinds(heard(office)) == []


@pytest.mark.parametrize("kind", ["dead", "mirrored", "no_reverse", "scale"])
def test_in_the_office(office: Log, kind: str) -> None:
    motions = heard(spoiled(office, WRONG[kind]))
    assert kinds(motions) == [kind]
    last, truth = motions[-1].pose, office.ground_truth.poses
    way = between(motions[0].pose, last)
    true = between(truth[0], truth[-1])
    assert math.hypot(*(way - true)[:2]) < 0.7, "the way is known all the same"
    assert abs(float(wrap_angle(way[2] - true[2]))) < 0.1


@pytest.mark.parametrize(("to", "kind"), [((0.0, 0.0, 0.0), "restarted"), ((80.0, -9.0, 2.0), "slipped")])
def test_an_odometry_that_leaps_counts_on_from_where_it_was(office: Log, to: tuple[float, ...], kind: str) -> None:
    at, odometry = 200, office.odometry.copy()
    odometry[at:] = compose(to, between(odometry[at], odometry[at:]))
    assert leapt(between(odometry[at - 1], odometry[at]), float(office.times[at] - office.times[at - 1]))
    before, now = heard(office), heard(dataclasses.replace(office, odometry=odometry))
    assert [(k, fault.kind) for k, motion in enumerate(now) for fault in motion.faults] == [(at, kind)]
    np.testing.assert_allclose(
        between(now[at].odometry, now[-1].odometry), between(before[at].odometry, before[-1].odometry), atol=1e-9
    )
    apart = between(before[-1].pose, now[-1].pose)
    assert math.hypot(apart[0], apart[1]) < 0.1
    assert abs(apart[2]) < 0.02
    names = [component.name for component in prior_of(now[at - 1], now[at]).components]
    assert "wheels" not in names


def test_late_wheels_are_trusted_less(office: Log) -> None:
    log = dataclasses.replace(office, odometry=np.vstack([office.odometry[:1]] * 2 + [office.odometry[:-2]]))
    motions = heard(dataclasses.replace(log, sweeps=None))
    assert "late" in kinds(motions)
    k = next(k for k, motion in enumerate(motions) if motion.late and motions[k - 1].late)
    assert motions[k].late == pytest.approx(0.4, abs=0.05)
    (told,) = (c for c in prior_of(motions[k - 1], motions[k]).components if c.name == "wheels")
    assert told.table is None
    assert math.sqrt(told.covariance[2, 2]) > 0.1


def test_wheels_that_are_heard_alone_stand_still_over_a_leap(office: Log) -> None:
    at, odometry = 200, office.odometry.copy()
    odometry[at:] = compose((0.0, 0.0, 0.0), between(odometry[at], odometry[at:]))
    log = dataclasses.replace(office, odometry=odometry)
    witnesses = Witnesses(log.laser, Config(odometry="wheels"))
    motions = [witnesses.update(scan) for scan in log.scans()]
    assert [(k, fault.kind) for k, motion in enumerate(motions) for fault in motion.faults] == [(at, "restarted")]
    told = np.array([motion.odometry for motion in motions])
    steps, true = (between(poses[:-1], poses[1:]) for poses in (told, office.odometry))
    np.testing.assert_allclose(steps[at - 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.delete(steps, at - 1, 0), np.delete(true, at - 1, 0), atol=1e-9)
    np.testing.assert_allclose(without_leaps(log.times, odometry), told, atol=1e-9)
    (component,) = prior_of(motions[at - 1], motions[at], odometry="wheels").components
    assert component.name == "wheels"


def test_odometry_that_does_not_leap_is_the_same_to_the_last_bit(office: Log) -> None:
    assert without_leaps(office.times, office.odometry) is office.odometry
    witnesses = Witnesses(office.laser, Config(odometry="wheels"))
    assert all(witnesses.update(scan).odometry is scan.odometry for scan in office.scans())
