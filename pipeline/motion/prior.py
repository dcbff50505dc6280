"""The motion prior: a mixture over what the witnesses say, each with its own noise.

It is sampled as it is: a particle follows a witness with the probability that this one is right. So proposal and prior
are the same, and no particle needs a weight for having followed one or the other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.geometry import between, wrap_angle
from pipeline.motion.laser_odometry import Match
from pipeline.motion.wheels import OdometryMotion, odometry_motion
from pipeline.motion.witnesses import Motion

Array = NDArray[np.float64]

AGREE = 11.3
"""Chi-square with three degrees of freedom: of witnesses that are both right 99 % are closer to each other."""
ACCELERATION, SPEED = 1.0, 1.5
"""m/s^2, m/s: how an indoor robot may drive on, where nobody says how it did."""
TURN_RATE = 1.5
"""rad/s."""
LEAST = (1e-6, 1e-6, 1e-6)
"""m^2, m^2, rad^2: nobody is surer than 1 mm and a sixteenth of a degree."""


@dataclass(frozen=True)
class Component:
    """One way in which the robot may have moved: ``step`` (3,) m, m, rad in its own frame, ``covariance`` (3, 3), and
    the ``share`` of the particles that follow it. ``wheels``: by Table 5.6 itself, which is not a Gaussian."""

    name: str
    step: Array
    covariance: Array
    share: float
    wheels: OdometryMotion | None = None


@dataclass(frozen=True)
class Prior:
    """What the witnesses say together: the ``components``, the most trusted first; ``disagreement``: chi-square between
    wheels and laser in the directions that the laser holds, NaN if one of them says nothing."""

    components: tuple[Component, ...]
    disagreement: float

    @property
    def step(self) -> Array:
        """The most trusted word."""
        return self.components[0].step


def motion_prior(before: Motion, now: Motion, config: Config) -> Prior:
    """How the robot may have moved between two scans."""
    told = _by_wheels(before, now, config)
    if now.laser is None:
        assert told is not None, "neither witness is heard"
        return Prior((told,), math.nan)
    seen = _by_laser(before, now, config)
    if seen is None:
        return Prior((_unseen(before, now) if told is None else told,), math.nan)
    if told is None:
        helped = _helped(seen, _unseen(before, now), now.laser, before)
        lost = _unseen(before, now)
        return Prior((_shared(helped, 1.0 - UNSEEN), _shared(lost, UNSEEN)), math.nan)
    apart = seen.step - told.step
    apart[2] = wrap_angle(apart[2])
    disagreement = float(apart @ np.linalg.solve(seen.covariance + told.covariance, apart))
    helped = _helped(seen, told, now.laser, before)
    share = config.laser_share if disagreement < AGREE else 0.5
    return Prior((_shared(helped, share), _shared(told, 1.0 - share)), disagreement)


WHITE = 0.3
"""Share of the matches' own covariance that a step gets. These errors are against the same remembered walls, so that one
scan's is mostly taken back by the next: added up in full they would make the belief too wide (docs/motion.md)."""
UNSEEN = 0.02
"""Share of the particles that may be anywhere nearby, where only the laser says how the robot moved: it may err."""


def _shared(component: Component, share: float) -> Component:
    return Component(component.name, component.step, component.covariance, share, component.wheels)


def _by_wheels(before: Motion, now: Motion, config: Config) -> Component | None:
    if before.odometry is None or now.odometry is None:
        return None
    m = odometry_motion(before.odometry, now.odometry, config)
    step = between(before.odometry, now.odometry)
    jacobian = np.array([[-step[1], math.cos(m.rot1), 0.0], [step[0], math.sin(m.rot1), 0.0], [1.0, 0.0, 1.0]])
    noise = np.diag([m.std_rot1**2, m.std_trans**2, m.std_rot2**2])
    return Component("wheels", step, jacobian @ noise @ jacobian.T + np.diag(LEAST), 1.0, m)


def _by_laser(before: Motion, now: Motion, config: Config) -> Component | None:
    a, b = before.laser, now.laser
    if a is None or b is None or a.stretch != b.stretch:
        return None
    step = between(a.pose, b.pose)
    c, s = math.cos(a.pose[2]), math.sin(a.pose[2])
    into = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    # An error of the earlier heading swings the step round.
    swing = np.array([[1.0, 0.0, -step[1]], [0.0, 1.0, step[0]], [0.0, 0.0, 1.0]])
    driven = math.hypot(step[0], step[1]) + 0.5 * abs(step[2])
    drift = np.diag([config.laser_drift_d**2, config.laser_drift_d**2, config.laser_drift_a**2]) * driven
    first, second = swing @ into @ a.covariance @ into.T @ swing.T, into @ b.covariance @ into.T
    return Component("laser", step, WHITE * (first + second) + drift + np.diag(LEAST), 1.0)


def _unseen(before: Motion, now: Motion) -> Component:
    """Nobody says: as far as a robot drives in that time."""
    seconds = now.time - before.time
    step = between(before.pose, now.pose)
    reach = min(0.5 * ACCELERATION * seconds**2 + 0.02, SPEED * seconds, 3.0)
    turn = min(0.5 * 2.0 * seconds**2 + 0.02, TURN_RATE * seconds, math.pi)
    return Component("unseen", step, np.diag([reach**2, reach**2, turn**2]) + np.diag(LEAST), 1.0)


def _helped(seen: Component, other: Component, match: Match, before: Motion) -> Component:
    """As the laser says; only in a direction that it leaves open as the other does."""
    if match.open is None:
        return seen
    assert before.laser is not None
    c, s = math.cos(before.laser.pose[2]), math.sin(before.laser.pose[2])
    way = np.array([c * match.open[0] + s * match.open[1], c * match.open[1] - s * match.open[0], 0.0])
    say = np.outer(way, way) / float(way @ other.covariance @ way)
    covariance = np.asarray(np.linalg.inv(np.linalg.inv(seen.covariance) + say), np.float64)
    return Component("laser", seen.step, covariance, 1.0)
