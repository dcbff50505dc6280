"""What one scan did to the belief: the only thing that leaves the filter."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.data_frame import data_frame

if TYPE_CHECKING:  # whoever only reads steps must not wait for numba
    import pandas as pd

    from pipeline.judgement.verdict import Verdict
    from pipeline.motion.prior import Prior
    from pipeline.motion.witnesses import Motion

Scalar = TypeVar("Scalar", bound=np.generic)


@dataclass(frozen=True)
class Estimate:
    """A Gaussian summary of (a part of) the belief in the map frame.

    ``pose``: (3,) m, m, rad; ``covariance``: (3, 3) of x, y, yaw; ``weight``: its share of the whole belief;
    ``name``: after a gap, what became of the robot meanwhile if this is where it is; else empty.
    """

    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    weight: float = 1.0
    name: str = ""

    def __repr__(self) -> str:
        x, y, yaw = self.pose
        sigmas = np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))
        return (
            f"Estimate(({x:.2f}, {y:.2f}) m, {math.degrees(yaw):.0f} deg, sigma {sigmas[0]:.2f} m, {sigmas[1]:.2f} m, "
            f"{math.degrees(sigmas[2]):.1f} deg, {100 * self.weight:.0f} % of the belief)"
        )


@dataclass(frozen=True)
class Beams:
    """The beams that the sensor model used, at the estimate.

    ``laser``: (3,) pose of the laser in the map frame; ``angles``: (k,) rad in the laser frame;
    ``measured``: (k,) float32 m as the model saw them (inf = no return, NaN = invalid);
    ``expected``: (k,) float32 m, true ranges z* from the map, NaN where a beam ended on land that it does not know;
    ``worth``: nats by which the pose explains a beam better, in the mean, than a reading of this laser is probable.
    """

    laser: NDArray[np.float64]
    angles: NDArray[np.float64]
    measured: NDArray[np.float32]
    expected: NDArray[np.float32]
    worth: float = 0.0

    def __repr__(self) -> str:
        x, y, yaw = self.laser
        where = f"({x:.2f}, {y:.2f}) m, {math.degrees(yaw):.0f} deg"
        return f"Beams({len(self.measured)} from {where}, worth {self.worth:.2f} nats each)"


TAKEOVERS = ("lost", "changed")
"""Kinds of events at which another place took the estimate's: the first of a loss, and any more until it is found."""


@dataclass(frozen=True)
class Event:
    """Something worth a line: ``kind`` is a word (started, searched, converged, diverged, resampled,
    lost, changed, found, contradicted, gap, or a fault of the wheels), ``text`` a sentence."""

    kind: str
    text: str
    level: str = "INFO"  # INFO or WARN


@dataclass(frozen=True)
class Step:
    """One update of the filter; its arrays are read-only.

    As the filter returns it, ``particles``, ``log_weights`` and ``walls`` are views that the next update changes.
    Whoever gets steps from outside of the filter, a sink or who iterates over ``Localizer``, gets ``own()``, which
    nothing changes any more.

    ``particles``: (n, 3) float32, x, y, yaw in the map frame; ``log_weights``: (n,) float64, normalised so that
    the weights sum to one, before resampling; ``clusters``: the hypotheses, heaviest first, ``estimate`` is the first.
    ``ess``: effective sample size 1 / sum(w^2); ``mean_likelihood``: geometric mean over beams and mean over
    particles of p(z | z*), per metre; ``explained``: share of the estimate's beams that the map explains;
    ``short`` and ``through``: shares of the beams that end before what is mapped, so that something is in the way, and
    that end far behind it, side by side: the robot is elsewhere, or the wall is gone;
    ``changed`` (m, 3) float32, where more became known at this scan: x, y in the map frame of the cells in which the
    world is not as mapped, and how: 1 there is a wall, 2 a wall is gone, 3 there is floor where nothing was known;
    ``heat`` (m, 3) float32, where the building was searched at this scan: x, y in the map frame of the best cells, and
    by how many nats, tempered, the best pose in each is behind the best of all (0 or less).
    ``spread``: RMS distance of the particles from the estimate, m; ``moved``: the robot moved since the last update.
    ``verdict``: what can be trusted of the estimate; ``off_map``: share of the belief on land that the map lacks;
    ``motion``: what wheels and laser say of the way so far; ``prior``: how the particles moved, None if they did not;
    ``followed`` (components of the prior,): how much of the weight, once weighed, is of particles that followed each,
    None without a prior. ``walls`` (4, k) float32: what the laser's odometry remembers, points (m) in its own frame and
    normals; None if only the wheels are heard.
    """

    index: int
    stamp: int
    time: float
    particles: NDArray[np.float32]
    log_weights: NDArray[np.float64]
    estimate: Estimate
    clusters: tuple[Estimate, ...]
    beams: Beams
    ess: float
    mean_likelihood: float
    explained: float
    spread: float
    moved: bool
    resampled: bool
    motion: Motion
    verdict: Verdict
    short: float = 0.0
    through: float = 0.0
    off_map: float = 0.0
    prior: Prior | None = None
    followed: NDArray[np.float64] | None = None
    walls: NDArray[np.float32] | None = None
    changed: NDArray[np.float32] | None = None
    heat: NDArray[np.float32] | None = None
    events: tuple[Event, ...] = ()

    def __repr__(self) -> str:
        x, y, yaw = self.estimate.pose
        return (
            f"Step({self.index} at {self.time:.2f} s: {len(self.particles):,} particles, "
            f"estimate ({x:.2f}, {y:.2f}) m, {math.degrees(yaw):.0f} deg, "
            f"{self.verdict.kind} with probability {self.verdict.probability:.2f})"
        )

    def own(self) -> Step:
        """The same step with arrays of its own, which no later update changes; read-only as well."""
        walls = None if self.walls is None else _kept(self.walls)
        return replace(self, particles=_kept(self.particles), log_weights=_kept(self.log_weights), walls=walls)

    @property
    def weights(self) -> NDArray[np.float64]:
        """(n,) the particles' weights, summing to one."""
        return np.exp(self.log_weights)

    def to_pandas(self) -> pd.DataFrame:
        """A row per particle: x, y (m), yaw (rad) in the map frame, weight. Raises MclError without pandas."""
        x, y, yaw = self.particles.T
        return data_frame({"x": x, "y": y, "yaw": yaw, "weight": self.weights})


def _kept(array: NDArray[Scalar]) -> NDArray[Scalar]:
    copy = array.copy()
    copy.flags.writeable = False
    return copy
