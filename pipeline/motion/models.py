"""Motion models: how far the robot's step may be from what the wheels say. A built-in one, or the user's own."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.geometry import between, wrap_angle
from pipeline.motion.wheels import ON_THE_SPOT, OdometryMotion, odometry_motion
from pipeline.parts.loading import built_in
from pipeline.parts.own import Own
from pipeline.parts.roles import ROLES

Array = NDArray[np.float64]

LEAST = np.diag([1e-6, 1e-6, 1e-6])
"""m^2, m^2, rad^2: nobody is surer than 1 mm and a sixteenth of a degree."""
DRAWS = 256
"""Steps of a sampled model from which its mean and its covariance are told."""


@dataclass(frozen=True)
class Component:
    """One way in which the robot may have moved: ``step`` (3,) m, m, rad in its own frame, ``covariance`` (3, 3), and
    the ``share`` of the particles that follow it. ``table``: by Table 5.6 itself, which is not quite a Gaussian;
    ``sampled``: by a model of the user's own that moves particles itself, of which the rest is a summary."""

    name: str
    step: Array
    covariance: Array
    share: float = 1.0
    table: OdometryMotion | None = None
    sampled: Sampled | None = None

    @property
    def reach(self) -> float:
        """Deviation of where the step ends, along or across, m."""
        return math.sqrt(float(self.covariance[0, 0]))


class MotionModel(Protocol):
    """What a motion model is to the motion prior."""

    def component(self, name: str, before: Array, after: Array, seconds: float) -> Component:
        """The step between two poses (3,) m, m, rad of the odometry, ``seconds`` apart, with its noise."""


class Odometry:
    """The odometry motion model of Table 5.6, with the noise ``alpha1`` to ``alpha4``."""

    def __init__(self, config: Config) -> None:
        self._config = config

    def component(self, name: str, before: Array, after: Array, seconds: float) -> Component:  # noqa: ARG002
        """As ``MotionModel`` has it."""
        m, step = odometry_motion(before, after, self._config), between(before, after)
        jacobian = np.array([[-step[1], math.cos(m.rot1), 0.0], [step[0], math.sin(m.rot1), 0.0], [1.0, 0.0, 1.0]])
        noise = np.diag([m.std_rot1**2, m.std_trans**2, m.std_rot2**2])
        return Component(name, step, jacobian @ noise @ jacobian.T + LEAST, table=m)


class Omnidirectional:
    """AMCL's model of a robot that drives in any direction whatever its heading, with ``alpha1`` to ``alpha5``.

    A drive errs along its own direction (alpha3, alpha1 for the turn meanwhile), across it (alpha5, alpha1), and in
    heading (alpha4 for the turn, alpha2 for the way).
    """

    def __init__(self, config: Config) -> None:
        self._config = config

    def component(self, name: str, before: Array, after: Array, seconds: float) -> Component:  # noqa: ARG002
        """As ``MotionModel`` has it."""
        c, step = self._config, between(before, after)
        trans, turn = math.hypot(step[0], step[1]), float(step[2])
        bearing = math.atan2(step[1], step[0]) if trans >= ON_THE_SPOT else 0.0
        along = c.alpha3 * trans**2 + c.alpha1 * turn**2
        across = c.alpha1 * turn**2 + c.alpha5 * trans**2
        heading = c.alpha4 * turn**2 + c.alpha2 * trans**2
        cos, sin = math.cos(bearing), math.sin(bearing)
        into = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return Component(name, step, into @ np.diag([along, across, heading]) @ into.T + LEAST)


class Sampled:
    """A step by a model of the user's own that moves particles."""

    def __init__(self, own: Own, before: Array, after: Array, seconds: float) -> None:
        self._own, self._leads, self._seconds = own, (before, after), seconds

    def move(self, poses: NDArray[np.float32], key: int) -> Array:
        """(3, n) where poses (3, n) float32 are after the step, with random numbers from ``key``."""
        rng = np.random.Generator(np.random.Philox(key=key))
        answer = self._own(poses.copy(), *(lead.copy() for lead in self._leads), rng=rng, seconds=self._seconds)
        return self._own.poses(answer, poses.shape)


class OwnModel:
    """A model of the user's own: one that moves particles, or tells a Gaussian."""

    def __init__(self, own: Own) -> None:
        self._own = own

    def component(self, name: str, before: Array, after: Array, seconds: float) -> Component:
        """As ``MotionModel`` has it."""
        own = self._own
        if own.method.name == "gaussian":
            answer = own(before.copy(), after.copy(), seconds=seconds)
            step, covariance = own.pair(answer, "a step (3,) and its covariance (3, 3)")
            return Component(name, own.poses(step, (3,), "a step"), own.covariance(covariance) + LEAST)
        sampled = Sampled(own, before, after, seconds)
        # Of robots at the origin, always with the same random numbers: a summary is no draw.
        steps = sampled.move(np.zeros((3, DRAWS), np.float32), 0)
        mean = steps.mean(axis=1)
        mean[2] = math.atan2(np.sin(steps[2]).mean(), np.cos(steps[2]).mean())
        off = steps - mean[:, None]
        off[2] = wrap_angle(off[2])
        return Component(name, mean, off @ off.T / (DRAWS - 1) + LEAST, sampled=sampled)


def motion_model(config: Config) -> MotionModel:
    """The model that ``config.motion_model`` names."""
    own = config.own_part("motion_model")
    model: MotionModel = OwnModel(own) if own else built_in(ROLES["motion_model"], config.motion_model)(config)
    return model
