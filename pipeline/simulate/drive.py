"""The robot's true motion: a unicycle that follows its orders with limited speed, acceleration and turn rate."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.errors import MclError
from pipeline.geometry import wrap_angle
from pipeline.simulate.building import Leg, Point, Robot

Array = NDArray[np.float64]

STEP = 0.02  # seconds
PATIENCE = 300.0  # seconds that a leg may take
STEERING = 3.0  # turn rate per heading error, 1/s
TURN_FIRST = math.radians(50.0)  # a larger heading error is turned away on the spot
CUT_CORNER = 0.5  # metres before a point that is only driven through
ARRIVED = 0.03  # metres before a point where the robot stops
FACING = math.radians(0.3)


@dataclass(frozen=True)
class Drive:
    """The true motion: ``times`` (n,) s from 0; ``poses`` (n, 3) of the robot's centre, map frame, yaw unwrapped."""

    times: Array
    poses: Array

    def at(self, times: ArrayLike) -> Array:
        """Poses (k, 3) at ``times`` (k,) s; the first and last pose before and after the drive."""
        return interpolate(np.asarray(times, dtype=np.float64), self.times, self.poses)

    @property
    def length(self) -> float:
        """Metres driven."""
        return float(np.hypot(*np.diff(self.poses[:, :2], axis=0).T).sum())


def interpolate(times: Array, known_times: Array, known_poses: Array) -> Array:
    """Poses (k, 3) at ``times`` (k,), between ``known_poses`` (n, 3), yaw unwrapped, at ``known_times`` (n,)."""
    return np.stack([np.interp(times, known_times, known_poses[:, i]) for i in range(3)], axis=-1)


class _Unicycle:
    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.x, self.y = robot.start
        self.yaw = math.radians(robot.heading_deg)
        self.speed = 0.0
        self.poses = [(self.x, self.y, self.yaw)]

    def step(self, speed: float, turn_rate: float) -> None:
        """One step towards the wanted speed (m/s, negative is backwards) at the wanted turn rate (rad/s)."""
        change = self.robot.acceleration * STEP
        self.speed += min(max(speed - self.speed, -change), change)
        limit = math.radians(self.robot.turn_rate_deg)
        middle = self.yaw + 0.5 * STEP * min(max(turn_rate, -limit), limit)
        self.x += STEP * self.speed * math.cos(middle)
        self.y += STEP * self.speed * math.sin(middle)
        self.yaw += 2.0 * (middle - self.yaw)
        self.poses.append((self.x, self.y, self.yaw))


def drive(robot: Robot) -> Drive:
    """The motion that follows from the robot's orders.

    Raises MclError for a point that the robot cannot reach (it would circle around it for ever).
    """
    wheels = _Unicycle(robot)
    for i, (leg, after) in enumerate(zip(robot.legs, [*robot.legs[1:], None], strict=True)):
        for steps, (speed, turn_rate) in enumerate(_commands(wheels, leg, after)):
            if steps * STEP > PATIENCE:
                raise MclError(f"robot.legs[{i}]: not done after {PATIENCE:g} s", "does it circle around the point?")
            wheels.step(speed, turn_rate)
    return Drive(STEP * np.arange(len(wheels.poses), dtype=np.float64), np.array(wheels.poses, dtype=np.float64))


def _commands(wheels: _Unicycle, leg: Leg, after: Leg | None) -> Iterator[tuple[float, float]]:
    """Wanted speed and turn rate of every step until the leg is done."""
    if leg.to is not None:
        stop = after is None or after.to is None or after.backwards != leg.backwards
        return _towards(wheels, leg.to, leg.speed or wheels.robot.speed, backwards=leg.backwards, stop=stop)
    if leg.turn_deg is not None:
        return _turn(wheels, wheels.yaw + math.radians(leg.turn_deg))
    return itertools.repeat((0.0, 0.0), round((leg.pause or 0.0) / STEP))


def _turn(wheels: _Unicycle, goal: float) -> Iterator[tuple[float, float]]:
    while abs(goal - wheels.yaw) > FACING:
        yield 0.0, STEERING * (goal - wheels.yaw)


def _towards(
    wheels: _Unicycle, to: Point, speed: float, *, backwards: bool, stop: bool
) -> Iterator[tuple[float, float]]:
    sign = -1.0 if backwards else 1.0
    while True:
        dx, dy = sign * (to[0] - wheels.x), sign * (to[1] - wheels.y)
        left = math.hypot(dx, dy)
        error = float(wrap_angle(math.atan2(dy, dx) - wheels.yaw))
        if left < (ARRIVED if stop else CUT_CORNER) or (left < CUT_CORNER and abs(error) > math.pi / 2):
            return
        wanted = 0.0 if abs(error) > TURN_FIRST else speed * math.cos(error)
        if stop:  # brake in time
            wanted = min(wanted, math.sqrt(wheels.robot.acceleration * left))
        yield sign * wanted, STEERING * error
