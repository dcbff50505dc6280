"""AMCL's own parameters, for nav2: learned from how its filter works, not copied from ours.

AMCL hears the wheels alone and updates once the robot has moved by update_min_d or update_min_a, so the alphas are
learned at that pace. Its likelihood_field asks how far from the nearest wall a beam ends, not from the wall along the
beam, so sigma_hit and z_hit are learned from those distances. What ours has beside that (z_long, range_bias,
independent_beams, the laser's odometry) it has no word for. docs/tuning.md has the measurements behind the constants.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.geometry import compose, wrap_angle
from pipeline.maps.distance_field import build_distance_field
from pipeline.nav2 import PARAMETERS
from pipeline.tune.em import Array
from pipeline.tune.found import Found
from pipeline.tune.motion import ALPHAS, FEWEST, fit_motion, windows
from pipeline.tune.reasons import Reason

PACE = 0.25, 0.2
"""m, rad: AMCL's updates, as its defaults have them. Where wheels do what no model expects it is lost the sooner, the
shorter they are: at 0.1 m on the log of Freiburg, whose wheels know no reverse."""
FREER = 3.0
"""Times the variance that was measured: AMCL has no other noise by which particles reach a pose that they missed."""
LEAST_ALPHA, MOST_ALPHA = 0.005, 1.0
OF_A_GAUSSIAN = 2.58
"""Deviations beyond which lies one error in a hundred."""
POSSIBLE = 1.0
"""m, rad: a window in which the wheels err by more is a robot that was carried."""
SMALLEST_ERROR = 0.02
"""m, rad: what hindsight itself may err by in a window."""
ROUNDS = 5
OCCUPIED = 0.65
"""From which probability on map_server, of nav2, draws a wall."""
NEAR = 0.5
"""m: beams that end farther from all walls do not see a wall of the map."""
LEAST_SIGMA, MOST_SIGMA = 0.08, 0.2
LEAST_HIT, MOST_HIT = 0.8, 0.9
"""In a sum of cubes z_hit says how much all beams together count beside the 1 that every pose has: how sure AMCL is."""
WILD = 2.0
"""The wheels are so if one window in a hundred errs so many times more than their alphas say: 6 at Freiburg, whose
wheels know no reverse, and at most 1.7 on seven other logs. AMCL is lost for good there if it is sure."""
WILD_SIGMA, WILD_HIT = 0.1, 0.6
"""The sigma_hit, at least, and the z_hit for such wheels."""
HEADING_FLOOR, WAY_FLOOR = 0.01, 0.02
"""rad, m: an error of so much is none of the wheels'."""
SCANS = 500
"""Of one log, spread over it."""
REACH = 2.0
"""m: laser_likelihood_max_dist."""


@dataclass(frozen=True)
class AmclFit:
    """AMCL's parameters by nav2's names, as they are written, and why each is what it is."""

    values: dict[str, Any]
    reasons: tuple[Reason, ...]


def fit_amcl(found: Sequence[Found], config: Config) -> AmclFit:
    """What nav2's AMCL should be given for the robot and the building of these logs."""
    d, a = PACE
    rows = [
        windows(f.log.odometry, f.trajectory, amcl_updates(f.log.odometry, f.scans, d, a), config)
        for f in found
        if f.way.wheels
    ]
    driven = np.concatenate([np.empty((0, 4)), *rows])
    told = len(driven) >= FEWEST
    reasons = [
        *_of_wheels(driven if told else driven[:0]),
        *_of_the_field(found, surprise(driven, config) if told else 0.0),
    ]
    values = {reason.name: reason.value for reason in reasons}
    return AmclFit({name: values[name] for name in PARAMETERS if name in values}, tuple(reasons))


def amcl_updates(odometry: Array, scans: NDArray[np.int64], d: float, a: float) -> NDArray[np.int64]:
    """Those of the ``scans`` (k,) at which AMCL updates: after ``d`` m along an axis of the odometry, or ``a`` rad."""
    kept: list[int] = []
    for scan in scans.tolist():
        if kept:
            delta = odometry[scan] - odometry[kept[-1]]
            if np.abs(delta[:2]).max() <= d and abs(float(wrap_angle(delta[2]))) <= a:
                continue
        kept.append(scan)
    return np.array(kept, np.int64)


def ends(found: Found) -> Array:
    """(m,) how far from the nearest wall the beams of a log end, m, at hindsight's poses; at most REACH."""
    log = found.log
    assert log.grid is not None
    field = build_distance_field(log.grid, OCCUPIED, REACH)
    rows = found.every(SCANS)
    at = compose(found.trajectory[rows], log.laser.pose)
    ranges = log.ranges[rows].astype(np.float64)
    yaw = at[:, 2:] + log.laser.angles
    back = np.isfinite(ranges) & (ranges < log.laser.range_max)
    x, y = at[:, :1] + np.where(back, ranges, 0.0) * np.cos(yaw), at[:, 1:2] + np.where(back, ranges, 0.0) * np.sin(yaw)
    points = log.grid.to_grid(np.stack([x[back], y[back], np.zeros(int(back.sum()))], axis=-1))
    cells = np.floor(points[:, :2] / log.grid.resolution).astype(np.int64)
    height, width = field.codes.shape
    inside = (cells >= 0).all(axis=1) & (cells[:, 0] < width) & (cells[:, 1] < height)
    out = np.full(len(cells), REACH)
    out[inside] = field.distances[field.codes[cells[inside, 1], cells[inside, 0]]]
    return out


def moments(rows: Array) -> tuple[float, float, float, float]:
    """alpha1 to alpha4 by which the wheels' errors have the size that they have, the worst of them included.

    ``rows`` (w, 4): as ``motion.windows`` has them. `mcl tune` leaves outliers out of its own alphas, since its filter
    follows the laser where the wheels slip; AMCL has nothing else to follow.
    """
    heading, along, turned, driven = rows.T
    alpha1, alpha2 = _moment(heading, np.column_stack([turned, 2.0 * driven]))
    alpha4, alpha3 = _moment(along, np.column_stack([turned, driven]))
    possible = np.abs(along) < POSSIBLE
    # Where a part of the drive errs much, the fit puts it to the turns or to the constant: alpha3 has to do alone.
    whole = float(np.square(along[possible]).sum() / max(float(driven[possible].sum()), 1e-9))
    return alpha1, alpha2, max(alpha3, whole), alpha4


def _moment(errors: Array, regressors: Array) -> tuple[float, float]:
    """What each of two regressors (n, 2) adds to the mean square of the errors (n,), beside a constant."""
    from scipy.optimize import nnls

    possible = np.abs(errors) < POSSIBLE
    squared = np.square(errors[possible])
    design = np.column_stack([regressors[possible], np.ones(len(squared))])
    scale = np.maximum(design.max(axis=0, initial=0.0), 1e-9)  # all near one: better conditioned
    predicted, solution = np.ones(len(squared)), np.zeros(3)
    for _ in range(ROUNDS):
        solution = nnls(design / scale / predicted[:, None], squared / predicted)[0] / scale
        predicted = np.maximum(design @ solution, SMALLEST_ERROR**2)
    return float(solution[0]), float(solution[1])


def surprise(rows: Array, config: Config) -> float:
    """How many times more the wheels err in the worst window of a hundred than Gaussian noise of their alphas would.

    ``rows`` (w, 4): as ``motion.windows`` has them. The alphas are those that leave outliers out.
    """
    fitted = fit_motion([rows], config)
    heading, along, turned, driven = rows.T
    expected = (
        np.sqrt(np.maximum(fitted.alpha1 * turned + 2.0 * fitted.alpha2 * driven, HEADING_FLOOR**2)),
        np.sqrt(np.maximum(fitted.alpha3 * driven + fitted.alpha4 * turned, WAY_FLOOR**2)),
    )
    worst = [float(np.quantile(np.abs(e) / s, 0.99)) for e, s in zip((heading, along), expected, strict=True)]
    return max(worst) / OF_A_GAUSSIAN


def _of_wheels(windowed: Array) -> list[Reason]:
    d, a = PACE
    pace = f"at an update every {d:g} m or {a:g} rad"
    why = "the alphas are learned for updates so far apart, and mean something else at others"
    out = [Reason("update_min_d", d, why, {}), Reason("update_min_a", a, why, {})]
    if not len(windowed):
        return out  # the file's own alphas stay, or AMCL's default
    fitted = dict(zip(ALPHAS, moments(windowed), strict=True))
    heading, way = (float(np.sqrt(np.mean(np.square(windowed[:, k])))) for k in (0, 1))
    for name in ALPHAS:
        measured = fitted[name]
        value = _digits(min(max(FREER * measured, LEAST_ALPHA), MOST_ALPHA))
        error = f"{math.degrees(heading):.2f} deg" if name in ("alpha1", "alpha2") else f"{way:.3f} m"
        text = (
            f"over {len(windowed):,} windows of 0.5 to 1.5 m the wheels err by {error} (RMS), which is {measured:.2g} "
            f"{pace}; times {FREER:g}, since AMCL's particles have no other way to spread, and at least {LEAST_ALPHA:g}"
        )
        out.append(Reason(name, value, text, {"windows": len(windowed), "measured": measured}))
    return out


def _of_the_field(found: Sequence[Found], surprised: float) -> list[Reason]:
    distances = np.concatenate([ends(f) for f in found])
    n = len(distances)
    near = distances[distances < NEAR]
    deviation = float(np.sqrt(np.mean(np.square(near)))) if len(near) else LEAST_SIGMA
    wild = surprised > WILD
    least = WILD_SIGMA if wild else LEAST_SIGMA
    sigma = _digits(min(max(deviation, least), MOST_SIGMA))
    hit = len(near) / max(n, 1)
    z_hit = WILD_HIT if wild else round(min(max(hit, LEAST_HIT), MOST_HIT), 3)
    z_rand = round(1.0 - z_hit, 3)
    of = f"of {n:,} beams at {sum(len(f.every(SCANS)) for f in found):,} scans"
    return [
        Reason("laser_model_type", "likelihood_field", "of AMCL's models it loses the robot least often", {}),
        Reason(
            "sigma_hit", sigma,
            f"{len(near):,} {of} end within {NEAR:g} m of a wall, {deviation:.3f} m from it (RMS); between "
            f"{least:g} and {MOST_SIGMA:g}",
            {"beams": len(near), "deviation": deviation},
        ),
        Reason(
            "z_hit", z_hit,
            f"{100 * hit:.1f} % {of} end within {NEAR:g} m of a wall; "
            + (
                f"the wheels err up to {surprised:.1f} times more than their noise says: AMCL must not be too sure"
                if wild else f"between {LEAST_HIT:g} and {MOST_HIT:g}"
            ),
            {"beams": n, "share": hit, "surprise": surprised},
        ),
        Reason("z_rand", z_rand, "the rest: AMCL normalises nothing, and its field has these two parts only", {}),
        Reason("laser_likelihood_max_dist", REACH, "farther from a wall than this, all ends count alike", {}),
    ]  # fmt: skip


def _digits(value: float) -> float:
    """Three digits: more than the logs can tell, and what is written is what is meant."""
    return float(f"{value:.3g}")
