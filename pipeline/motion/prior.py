"""The motion prior: a mixture over what the witnesses say, each with its own noise.

It is sampled as it is: a particle follows a witness with the probability that this one is right. So proposal and prior
are the same, and no particle needs a weight for having followed one or the other (as in Hesterberg's defensive
mixtures, 1995, some follow each).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.geometry import between, wrap_angle
from pipeline.motion.laser_odometry import ANYWHERE, Match
from pipeline.motion.models import LEAST, Component, MotionModel
from pipeline.motion.witnesses import Motion

Array = NDArray[np.float64]

WHEELS, LASER, LOOSELY, UNSEEN, UNSEEN_BY_WHEELS = "wheels", "laser", "laser, loosely", "unseen", "wheels, unseen"
AGREE = 11.3
"""Chi-square with three degrees of freedom: of witnesses that are both right 99 % are closer to each other."""
SOME = 0.1
"""Share of the particles that follow the wheels where they agree with the laser."""
EITHER = 0.5
"""The same where they do not: the map decides."""
NEARBY = 0.02
"""Share that may be anywhere nearby, where only the laser says how the robot moved: it may err."""
MOMENT = 1.0
"""s: between scans farther apart in time a match errs about as often as not, if no wheels say where to look for it."""
WHITE = 0.3
"""Share of the matches' own covariance that a step gets. Two scans err against the same remembered walls, so that the
next step mostly takes back the error of this one: added up in full they would make the belief too wide."""
ALIKE = 0.3
"""Sine of the angle below which two open directions are one."""
ACCELERATION, SPEED, FARTHEST = 1.0, 1.5, 3.0
"""m/s^2, m/s, m: how an indoor robot may drive on, where nobody says how it did."""
TURNING, TURN_RATE = 2.0, 1.5
"""rad/s^2, rad/s: the same of its heading."""
GYROSCOPE, GYROSCOPE_SCALE = 0.003, 0.02
"""rad, and share of the turn: deviation of a turn by the gyroscope."""
GAP_D, GAP_A, ABOUT = 0.7, 0.3, 0.05
"""m, rad: deviation of where a drive ends that only the wheels saw, for some ten seconds; and the share of particles
that have it, beside those that have the noise of Table 5.6."""


@dataclass(frozen=True)
class Prior:
    """What the witnesses say together: the ``components``, the most trusted first; ``disagreement``: chi-square between
    wheels and laser in the directions that the laser holds, NaN if one of them says nothing."""

    components: tuple[Component, ...]
    disagreement: float = math.nan

    @property
    def unseen(self) -> Component | None:
        """The component of a drive that nobody saw, if there is one."""
        return next((component for component in self.components if component.name == UNSEEN), None)

    @property
    def witnesses(self) -> tuple[Component, ...]:
        """The components without the one that follows the laser loosely, whose share goes to the laser.

        For whoever looks at particles that are farther apart than the two differ.
        """
        loose = sum(component.share for component in self.components if component.name == LOOSELY)
        return tuple(
            replace(component, share=component.share + loose * (component.name == LASER))
            for component in self.components
            if component.name != LOOSELY
        )

    @property
    def exactly(self) -> Prior:
        """As the laser says and nobody else, with its own noise, if it does: for a place where the map cannot tell
        whom of the two to believe."""
        lasers = tuple(replace(component, share=1.0) for component in self.components if component.name == LASER)
        return replace(self, components=lasers or self.components)

    @property
    def loosely(self) -> Prior:
        """The same with the wheels' noise only, for a place that is known roughly and must settle where the map has it:
        as the wheels say where they agree with the laser, else as either says."""
        by_name = {component.name: component for component in self.components}
        if LOOSELY not in by_name:
            return self
        if WHEELS in by_name and self.disagreement < AGREE:
            return replace(self, components=(by_name[WHEELS],))
        loose = by_name[LOOSELY]
        wide = replace(loose, share=by_name[LASER].share + loose.share)
        rest = [component for component in self.components if component.name not in (LASER, LOOSELY)]
        return replace(self, components=(wide, *rest))

    def without(self, one: Component) -> Prior:
        """The same without one component, unless it is all that there is."""
        rest = tuple(component for component in self.components if component is not one)
        return replace(self, components=rest or self.components)


def motion_prior(before: Motion, now: Motion, config: Config, model: MotionModel) -> Prior:
    """How the robot may have moved between two scans; ``model``: how far from what the wheels say.

    Most particles follow the laser: ``config.laser_share`` of them with its own small noise, the rest with that of the
    wheels, so that some are always left where a map that is drawn a little wrong wants them. Some follow the wheels,
    or half of all where the two disagree.
    """
    told = _by_wheels(before, now, model)
    if now.laser is None:
        assert told is not None, "neither witness is heard"
        return Prior((told,))
    seen = _by_laser(before, now, config)
    other = _unseen(before, now) if told is None else told
    others = [other] if (turned := _by_gyroscope(other, before, now)) is None else [turned, other]
    if now.unseen is not None and told is not None:
        return Prior(_after_gap(told))
    if seen is None:
        return Prior(_shared(others, 1.0))
    disagreement, share = math.nan, NEARBY if now.time - before.time < MOMENT else EITHER
    if told is not None:
        disagreement = _chi_square(seen, told)
        share = SOME if disagreement < AGREE else EITHER
    assert before.laser is not None
    exactly = _helped(seen, other, before.laser, now.laser)
    loosely = model.component(LOOSELY, np.zeros(3), exactly.step, now.time - before.time)
    most = (1.0 - share) * (1.0 if "loosely" in config.without else config.laser_share)
    lasers = _shared([exactly], most) + _shared([loosely], 1.0 - share - most)
    return Prior((*lasers, *_shared(others, share)), disagreement)


def _after_gap(told: Component) -> tuple[Component, ...]:
    """As the wheels say; or about so, since over a long way they may err by more than Table 5.6 has it.

    What the laser matched, poorly, are walls that it had not seen before: particles that followed it were lost in a
    third of such gaps (docs/motion.md).
    """
    loose = np.diag([GAP_D, GAP_D, GAP_A]) ** 2
    wide = Component(UNSEEN_BY_WHEELS, told.step, told.covariance + loose, ABOUT)
    return replace(told, share=1.0 - ABOUT), wide


def _shared(components: list[Component], share: float) -> tuple[Component, ...]:
    """The components, equal among each other, with this share together."""
    return tuple(replace(component, share=share / len(components)) for component in components)


def _by_wheels(before: Motion, now: Motion, model: MotionModel) -> Component | None:
    if before.odometry is None or now.odometry is None or now.unheard != before.unheard:
        return None
    told = model.component(WHEELS, before.odometry, now.odometry, now.time - before.time)
    if not now.late:
        return told
    # What they say is how the robot moved a moment ago: it may have changed its pace since.
    changed = abs(now.late) * (now.time - before.time)
    noise = np.diag([ACCELERATION, ACCELERATION, TURNING]) * changed
    return replace(told, covariance=told.covariance + noise**2, table=None, sampled=None)


def _by_laser(before: Motion, now: Motion, config: Config) -> Component | None:
    a, b = before.laser, now.laser
    if a is None or b is None or a.stretch != b.stretch:
        return None
    step = between(a.pose, b.pose)
    into = _turn_back(a.pose[2])
    # An error of the earlier heading swings the step round.
    swing = np.array([[1.0, 0.0, -step[1]], [0.0, 1.0, step[0]], [0.0, 0.0, 1.0]]) @ into
    driven = math.hypot(step[0], step[1]) + 0.5 * abs(step[2])
    drift = np.diag([config.laser_drift_d**2, config.laser_drift_d**2, config.laser_drift_a**2]) * driven
    matches = swing @ _held(a) @ swing.T + into @ _held(b) @ into.T
    anywhere = sum((np.outer(way, way) for way in _open_ways(a, b)), np.zeros((3, 3)))
    return Component(LASER, step, WHITE * matches + drift + LEAST + ANYWHERE * anywhere)


def _held(match: Match) -> Array:
    """The covariance (3, 3) of a match without the direction that it leaves open: two such directions, never quite
    the same, would leave the others open as well."""
    if match.open is None:
        return match.covariance
    way = np.array([*match.open, 0.0])
    projection = np.eye(3) - np.outer(way, way)
    return np.asarray(projection @ match.covariance @ projection, np.float64)


def _open_ways(before: Match, now: Match) -> list[Array]:
    """Unit vectors (3,) in the robot's frame, at right angles: the directions that one of two matches leaves open."""
    ways: list[Array] = []
    for match in (now, before):
        if match.open is None:
            continue
        way = _turn_back(before.pose[2]) @ np.array([*match.open, 0.0])
        way -= sum((known * (known @ way) for known in ways), np.zeros(3))
        if (length := float(np.linalg.norm(way))) > ALIKE:
            ways.append(way / length)
    return ways


def _unseen(before: Motion, now: Motion) -> Component:
    """Nobody says: as far as a robot drives in that time, around where dead reckoning has it.

    While nobody has seen its speed it may have become any other.
    """
    seconds = now.time - before.time
    changed = min(ACCELERATION * (before.blind + 0.5 * seconds), SPEED)
    reach = min(changed * seconds + 0.02, FARTHEST)
    turn = min(0.5 * TURNING * seconds**2 + 0.02, TURN_RATE * seconds + 0.02, math.pi)
    return Component(UNSEEN, between(before.pose, now.pose), np.diag([reach**2, reach**2, turn**2]))


def _by_gyroscope(other: Component, before: Motion, now: Motion) -> Component | None:
    """Another component's step, turned as the gyroscope says; None where it says nothing."""
    if before.turn is None or now.turn is None or not math.isfinite(now.turn - before.turn):
        return None
    turn = float(wrap_angle(now.turn - before.turn))
    covariance = other.covariance.copy()
    covariance[2, :] = covariance[:, 2] = 0.0
    covariance[2, 2] = GYROSCOPE**2 + (GYROSCOPE_SCALE * turn) ** 2
    return Component(f"{other.name}, turned by the gyroscope", np.array([*other.step[:2], turn]), covariance)


def _chi_square(seen: Component, told: Component) -> float:
    """How far apart two steps are, against both covariances; what the laser leaves open counts for nothing."""
    apart = seen.step - told.step
    apart[2] = wrap_angle(apart[2])
    return float(apart @ np.linalg.solve(seen.covariance + told.covariance, apart))


def _helped(seen: Component, other: Component, before: Match, now: Match) -> Component:
    """As the laser says; only in a direction that it leaves open, now or before, as the other does.

    The wheels' word is not multiplied in anywhere else: they err to one side, by 3 degrees a metre in one log.
    """
    if not (ways := _open_ways(before, now)):
        return seen
    say = sum((np.outer(way, way) / float(way @ other.covariance @ way) for way in ways), np.zeros((3, 3)))
    covariance = np.asarray(np.linalg.inv(np.linalg.inv(seen.covariance) + say), np.float64)
    # Where a hallway ends the laser sees how far the way through it was, all at once: no step is as long as that.
    step = seen.step + covariance @ say @ (other.step - seen.step)
    return replace(seen, step=step, covariance=covariance)


def _turn_back(yaw: float) -> Array:
    """(3, 3): from a frame into that of a pose turned by ``yaw`` in it."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
