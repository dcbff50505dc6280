"""Lesson 5.6: sampling from the odometry motion model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.geometry import wrap_angle
from pipeline.lessons.exam import Array, Function, Question, called, numbers, shaped
from pipeline.lessons.lesson import Lesson, Mistake

SAMPLES = 3000
"""Particles in every case."""
SURE = 6.0
"""Standard errors by which an answer may differ: of two hundred right answers, one in a million does by chance."""


def sample_motion_model_odometry(
    before: Array, now: Array, poses: Array, alphas: Array, rng: np.random.Generator
) -> Array:
    """Move particles as the odometry says, each with noise of its own (Probabilistic Robotics, Table 5.6).

    before, now: (3,) float64, two poses of the odometry, x (m), y (m), yaw (rad).
    poses: (n, 3) float64, the particles, x (m), y (m), yaw (rad) in the map's frame, which is not the odometry's.
    alphas: (4,) float64. The variance of either turn is alpha1 * turn^2 + alpha2 * drive^2, that of the drive
        is alpha3 * drive^2 + alpha4 * (turn1^2 + turn2^2); units rad^2/rad^2, rad^2/m^2, m^2/m^2, m^2/rad^2.
    rng: numpy's Generator, from which all noise is drawn: rng.standard_normal(n).
    Returns (n, 3): the particles after the move. Their yaw may differ by whole turns.
    """
    alpha1, alpha2, alpha3, alpha4 = alphas
    x, y, theta = poses.T
    n = len(poses)
    trans = np.hypot(now[0] - before[0], now[1] - before[1])
    rot1 = wrap_angle(np.arctan2(now[1] - before[1], now[0] - before[0]) - before[2])
    rot2 = wrap_angle(now[2] - before[2] - rot1)
    std_rot1 = np.sqrt(alpha1 * rot1**2 + alpha2 * trans**2)
    std_trans = np.sqrt(alpha3 * trans**2 + alpha4 * (rot1**2 + rot2**2))
    std_rot2 = np.sqrt(alpha1 * rot2**2 + alpha2 * trans**2)
    turn1 = rot1 - std_rot1 * rng.standard_normal(n)
    drive = trans - std_trans * rng.standard_normal(n)
    turn2 = rot2 - std_rot2 * rng.standard_normal(n)
    heading = theta + turn1
    return np.stack([x + drive * np.cos(heading), y + drive * np.sin(heading), heading + turn2], axis=1)


@dataclass(frozen=True)
class Move:
    """A move of the odometry, and the noise with which it is sampled."""

    name: str
    before: tuple[float, float, float]
    now: tuple[float, float, float]
    alphas: tuple[float, float, float, float]

    @property
    def parts(self) -> tuple[Array, Array]:
        """Turn, drive and turn again (3,), and their deviations (3,), from the book."""
        (x, y, yaw), (a1, a2, a3, a4) = self.before, self.alphas
        dx, dy = self.now[0] - x, self.now[1] - y
        trans, rot1 = float(np.hypot(dx, dy)), float(wrap_angle(np.arctan2(dy, dx) - yaw))
        rot2 = float(wrap_angle(self.now[2] - yaw - rot1))
        variances = (
            a1 * rot1**2 + a2 * trans**2,
            a3 * trans**2 + a4 * (rot1**2 + rot2**2),
            a1 * rot2**2 + a2 * trans**2,
        )
        return np.array([rot1, trans, rot2]), np.sqrt(variances)


MOVES = (
    Move("a turn, a drive and a turn, all with noise", (0.0, 0.0, 0.0), (1.0, 0.6, 0.1), (0.04, 0.01, 0.006, 0.005)),
    Move("a drive on which the yaw passes 180 degrees", (2.0, 1.0, 3.0), (1.2, 0.9, -2.9), (0.3, 0.02, 0.01, 0.02)),
    Move("alpha1 alone is not zero", (1.0, -2.0, 0.4), (1.5, -1.1, 0.7), (0.08, 0.0, 0.0, 0.0)),
    Move("alpha2 alone is not zero", (1.0, -2.0, 0.4), (1.5, -1.1, 0.7), (0.0, 0.03, 0.0, 0.0)),
    Move("alpha3 alone is not zero", (1.0, -2.0, 0.4), (1.5, -1.1, 0.7), (0.0, 0.0, 0.01, 0.0)),
    Move("alpha4 alone is not zero", (1.0, -2.0, 0.4), (1.5, -1.1, 0.7), (0.0, 0.0, 0.0, 0.02)),
)
_PARTS = (("the first turn", "rad"), ("the drive", "m"), ("the second turn", "rad"))
_SHARES = ((1.0, 0.682689), (2.0, 0.954500))
"""Of normal numbers, how many are within so many deviations."""
_LEAST = 1e-3
"""m, rad: what single precision may make of a deviation of zero."""


class Moments:
    """Many particles are moved; of every part of their moves, the mean, the deviation, how it goes with the others, and
    whether it is normally distributed, must be what the book says, up to what chance allows."""

    @cached_property
    def questions(self) -> Sequence[Question]:
        """What each number is."""
        asked = []
        for move in MOVES:
            asked += [Question(move.name, f"mean of {part}", unit, unit == "rad") for part, unit in _PARTS]
            asked += [Question(move.name, f"deviation of {part}", unit) for part, unit in _PARTS]
            for a, b in ((0, 1), (0, 2), (1, 2)):
                asked.append(Question(move.name, f"correlation of {_PARTS[a][0]} with {_PARTS[b][0]}"))
        within = [f"share of the noise within {limit:g} standard deviations" for limit, _ in _SHARES]
        return asked + [Question("shape of the noise", text) for text in within]

    @cached_property
    def expected(self) -> Array:
        """What the book has."""
        rows = [(*move.parts[0], *move.parts[1], 0.0, 0.0, 0.0) for move in MOVES]
        return np.array([*np.ravel(rows), *(share for _, share in _SHARES)])

    @cached_property
    def tolerance(self) -> Array:
        """So many standard errors, of so many samples."""
        rows = []
        for move in MOVES:
            deviations = move.parts[1]
            rows.append([*(deviations / np.sqrt(SAMPLES)), *(deviations / np.sqrt(2 * SAMPLES))])
            rows[-1] += [1.0 / np.sqrt(SAMPLES)] * 3
        drawn = SAMPLES * sum(int(np.count_nonzero(move.parts[1])) for move in MOVES)
        shares = [np.sqrt(share * (1.0 - share) / drawn) for _, share in _SHARES]
        return _LEAST + SURE * np.array([*np.ravel(rows), *shares])

    def ask(self, function: Function) -> Array:
        """The same of the particles that the function moves. Raises Unusable."""
        answers, noise = [], []
        for seed, move in enumerate(MOVES):
            rng = np.random.default_rng([5, 6, seed])
            poses = np.column_stack([rng.uniform(0.0, 20.0, (SAMPLES, 2)), rng.uniform(-np.pi, np.pi, SAMPLES)])
            arguments = (np.array(move.before), np.array(move.now), poses, np.array(move.alphas), rng)
            found = numbers(called(function, arguments), "the result", arguments)
            moved = shaped(found, poses.shape, "the result", arguments)
            parts, (right, deviations) = _told(poses, moved), move.parts
            off = parts - right
            off[:, [0, 2]] = wrap_angle(off[:, [0, 2]])
            own = off.std(axis=0)
            answers += [*(right + off.mean(axis=0)), *own, *_correlations(off, np.minimum(own, deviations))]
            noise += [(off[:, k] - off[:, k].mean()) / own[k] for k in range(3) if min(own[k], deviations[k]) > _LEAST]
        flat = np.abs(np.concatenate(noise)) if noise else np.zeros(1)
        return np.array([*answers, *(np.mean(flat < limit) for limit, _ in _SHARES)])


def _told(poses: Array, moved: Array) -> Array:
    """(n, 3): by how much each particle turned, drove, and turned again."""
    dx, dy = (moved[:, :2] - poses[:, :2]).T
    turn = wrap_angle(np.arctan2(dy, dx) - poses[:, 2])
    return np.stack([turn, np.hypot(dx, dy), wrap_angle(moved[:, 2] - poses[:, 2] - turn)], axis=1)


def _correlations(off: Array, deviations: Array) -> Array:
    """Between the three parts, where both have noise; 0 elsewhere."""
    found: Array = np.nan_to_num(np.asarray(np.corrcoef(off.T)))
    noisy = deviations > _LEAST
    return np.array([found[a, b] if noisy[a] and noisy[b] else 0.0 for a, b in ((0, 1), (0, 2), (1, 2))])


LESSON = Lesson(
    name="5.6",
    title="The odometry motion model, sampled",
    source="Probabilistic Robotics, Section 5.4 and Table 5.6",
    task=(
        "Between two scans the odometry tells a move: a turn towards the new place, a drive, and a turn to the new "
        "heading. Every particle makes this move in its own direction, and with noise of its own, drawn anew for "
        "each of the three parts. Mind that the difference of two angles may be off by a whole turn, and that the "
        "alphas make variances. The noise is normally distributed. A drive of exactly zero is not asked for."
    ),
    reference=sample_motion_model_odometry,
    exam=Moments(),
    mistakes=(
        Mistake("the second turn is subtracted", {"heading + turn2": "heading - turn2"}),
        Mistake("the first turn is subtracted", {"theta + turn1": "theta - turn1"}),
        Mistake("the second turn is left out", {"heading + turn2": "heading"}),
        Mistake(
            "the particle drives in its old direction, before the first turn",
            {"np.cos(heading)": "np.cos(theta)", "np.sin(heading)": "np.sin(theta)"},
        ),
        Mistake(
            "the particle drives in its new direction, after the second turn",
            {"np.cos(heading)": "np.cos(heading + turn2)", "np.sin(heading)": "np.sin(heading + turn2)"},
        ),
        Mistake(
            "sine and cosine are exchanged",
            {"np.cos(heading)": "np.sin(heading)", "np.sin(heading)": "np.cos(heading)"},
        ),
        Mistake(
            "x and y are exchanged in arctan2",
            {"np.arctan2(now": "(lambda y, x: np.arctan2(x, y))(now"},
        ),
        Mistake(
            "the old heading of the odometry is not subtracted from the first turn",
            {"now[0] - before[0]) - before[2])": "now[0] - before[0]))"},
        ),
        Mistake(
            "the first turn is not subtracted from the second", {"now[2] - before[2] - rot1": "now[2] - before[2]"}
        ),
        Mistake(
            "the new heading is used where the old one should be",
            {"now[0] - before[0]) - before[2])": "now[0] - before[0]) - now[2])"},
        ),
        Mistake(
            "the differences of angles are not wrapped into -180 to 180 degrees",
            {
                "wrap_angle(np.arctan2(now": "(np.arctan2(now",
                "rot2 = wrap_angle(now[2] - before[2] - rot1)": "rot2 = now[2] - before[2] - rot1",
            },
        ),
        Mistake(
            "the second turn is not wrapped into -180 to 180 degrees",
            {"wrap_angle(now[2] - before[2] - rot1)": "now[2] - before[2] - rot1"},
        ),
        Mistake(
            "variances are taken for deviations: the square root is missing",
            {
                "np.sqrt(alpha1 * rot1**2 + alpha2 * trans**2)": "(alpha1 * rot1**2 + alpha2 * trans**2)",
                "np.sqrt(alpha3 * trans**2": "(alpha3 * trans**2",
                "np.sqrt(alpha1 * rot2**2 + alpha2 * trans**2)": "(alpha1 * rot2**2 + alpha2 * trans**2)",
            },
        ),
        Mistake(
            "turns and drives are not squared in the variances",
            {
                "np.sqrt(alpha1 * rot1**2 + alpha2 * trans**2)": "np.sqrt(alpha1 * abs(rot1) + alpha2 * trans)",
                "alpha3 * trans**2 + alpha4 * (rot1**2 + rot2**2)": "alpha3 * trans + alpha4 * (abs(rot1) + abs(rot2))",
                "np.sqrt(alpha1 * rot2**2 + alpha2 * trans**2)": "np.sqrt(alpha1 * abs(rot2) + alpha2 * trans)",
            },
        ),
        Mistake(
            "alpha1 and alpha2 are exchanged",
            {"alpha1, alpha2, alpha3, alpha4 = alphas": "alpha2, alpha1, alpha3, alpha4 = alphas"},
        ),
        Mistake(
            "alpha3 and alpha4 are exchanged",
            {"alpha1, alpha2, alpha3, alpha4 = alphas": "alpha1, alpha2, alpha4, alpha3 = alphas"},
        ),
        Mistake(
            "alpha2 and alpha3 are exchanged",
            {"alpha1, alpha2, alpha3, alpha4 = alphas": "alpha1, alpha3, alpha2, alpha4 = alphas"},
        ),
        Mistake("the noise of the drive knows only the first turn", {"(rot1**2 + rot2**2)": "rot1**2"}),
        Mistake(
            "the noise of the drive has the square of the sum of the turns, not the sum of their squares",
            {"(rot1**2 + rot2**2)": "(rot1 + rot2) ** 2"},
        ),
        Mistake("the second turn has the noise of the first", {"std_rot2 * rng": "std_rot1 * rng"}),
        Mistake(
            "all particles have the same noise: one number is drawn for all of them",
            {
                "turn1 = rot1 - std_rot1 * rng.standard_normal(n)": "turn1 = rot1 - std_rot1 * rng.standard_normal()",
                "std_trans * rng.standard_normal(n)": "std_trans * rng.standard_normal()",
                "std_rot2 * rng.standard_normal(n)": "std_rot2 * rng.standard_normal()",
            },
        ),
        Mistake(
            "one random number is used for all three parts of a particle's move",
            {
                "turn1 = rot1": "noise = rng.standard_normal(n)\n    turn1 = rot1",
                "std_rot1 * rng.standard_normal(n)": "std_rot1 * noise",
                "std_trans * rng.standard_normal(n)": "std_trans * noise",
                "std_rot2 * rng.standard_normal(n)": "std_rot2 * noise",
            },
        ),
        Mistake(
            "the noise is uniform, and not normal",
            {
                "std_rot1 * rng.standard_normal(n)": "std_rot1 * rng.uniform(-1, 1, n)",
                "std_trans * rng.standard_normal(n)": "std_trans * rng.uniform(-1, 1, n)",
                "std_rot2 * rng.standard_normal(n)": "std_rot2 * rng.uniform(-1, 1, n)",
            },
        ),
        Mistake(
            "the noise is left out",
            {
                "std_rot1 * rng.standard_normal(n)": "0.0",
                "std_trans * rng.standard_normal(n)": "0.0 * x",
                "std_rot2 * rng.standard_normal(n)": "0.0",
            },
        ),
        Mistake(
            "the yaw is taken for degrees",
            {"np.cos(heading)": "np.cos(np.deg2rad(heading))", "np.sin(heading)": "np.sin(np.deg2rad(heading))"},
        ),
        Mistake(
            "the move is made in the odometry's frame, not in that of the particle",
            {"np.cos(heading)": "np.cos(before[2] + turn1)", "np.sin(heading)": "np.sin(before[2] + turn1)"},
        ),
        Mistake(
            "the old heading of the odometry is added to the first turn, and not subtracted",
            {"now[0] - before[0]) - before[2]": "now[0] - before[0]) + before[2]"},
        ),
        Mistake("the first turn is added to the second, and not subtracted", {"before[2] - rot1": "before[2] + rot1"}),
        Mistake("the drive goes backwards", {"turn1 = rot1": "trans = -trans\n    turn1 = rot1"}),
        Mistake("x goes backwards", {"x + drive": "x - drive"}),
        Mistake("y goes backwards", {"y + drive": "y - drive"}),
        Mistake(
            "alpha1's turn is not squared in the first turn's variance", {"alpha1 * rot1**2": "alpha1 * abs(rot1)"}
        ),
        Mistake(
            "the drive is added to its variance only once, and not squared", {"alpha3 * trans**2": "alpha3 * trans"}
        ),
        Mistake(
            "the noise of the first turn is a variance: its square root is missing",
            {"std_rot1 * rng": "std_rot1**2 * rng"},
        ),
        Mistake(
            "the noise of the drive is a variance: its square root is missing",
            {"std_trans * rng": "std_trans**2 * rng"},
        ),
        Mistake(
            "the noise of the second turn is a variance: its square root is missing",
            {"std_rot2 * rng": "std_rot2**2 * rng"},
        ),
    ),
)
