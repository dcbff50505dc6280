"""Faults of the wheels and of the recording, to be made on purpose: what each does to odometry and scans.

Only what the wheels say changes, and which scans there are: where the robot really was stays what it was, and what its
laser saw. So every log whose truth is known becomes a test. Moments are seconds since the log's first scan.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.geometry import between, wrap_angle
from pipeline.logs import schema
from pipeline.spelling import meant_or_known

Array = NDArray[np.float64]

MARGIN: Final = 15.0
"""s from the start and to the end of a log in which chance places no fault: to be lost, one must have been found."""
SPINNING: Final = 0.5
"""m/s that spinning wheels count, unless it is said."""


@dataclass(frozen=True)
class Fault:
    """A fault: one of ``KINDS``, its arguments (numbers; those not given are drawn when it is placed), its name."""

    kind: str
    args: tuple[float, ...]
    name: str

    @property
    def text(self) -> str:
        """As it is typed: ``turn:40:90``."""
        return ":".join([self.kind, *(f"{arg:.10g}" for arg in self.args if math.isfinite(arg))])

    @property
    def begin(self) -> float:
        """When it begins, s; 0 for one that lasts from start to end."""
        return self.args[0] if KINDS[self.kind].at is not None else 0.0

    @property
    def moment(self) -> float | None:
        """When the first scan can show it, s; None for one that lasts from the log's first scan on."""
        at = KINDS[self.kind].at
        return None if at is None or self.args[at] <= 0.0 else self.args[at]

    @property
    def carries_off(self) -> bool:
        """Whether the robot is somewhere else afterwards, and its wheels have not turned."""
        return self.kind in ("carried", "jump")


Change = Callable[[Array, Array, Array, tuple[float, ...]], Array]
"""(steps (n, 3) m, m, rad in the robot's frame, when each begins and ends (n,) s, arguments) -> the steps as told."""


@dataclass(frozen=True)
class Kind:
    """``arguments``: as the help names them, of which the first ``needed`` must be given.

    ``at``: the argument that says when the first scan can show it, None for a fault that lasts from start to end;
    ``change``: what the wheels make of steps; ``drawn``: the arguments that are not given, by chance.
    """

    arguments: tuple[str, ...]
    needed: int = 0
    at: int | None = None
    change: Change | None = None
    drawn: Callable[[tuple[float, ...], float, np.random.Generator], tuple[float, ...]] | None = None
    wheels: bool = True
    """Whether there must be odometry for it to disturb."""


# --- what wheels make of steps ------------------------------------------------------------------------------------


def _share(begin: Array, end: Array, since: float, until: float) -> tuple[Array, Array]:
    """Of each step the seconds, and the share, that lie between two moments."""
    seconds = np.clip(np.minimum(end, until) - np.maximum(begin, since), 0.0, None)
    return seconds, seconds / np.maximum(end - begin, 1e-9)


def _carried(steps: Array, begin: Array, end: Array, args: tuple[float, ...]) -> Array:
    within = (end >= args[0]) & (begin <= args[1])
    return np.where(within[:, None], 0.0, steps)


def _turned(steps: Array, begin: Array, end: Array, args: tuple[float, ...]) -> Array:
    here = (begin < args[0]) & (args[0] <= end)
    return steps + here[:, None] * np.array([0.0, 0.0, math.radians(args[1])])


def _slid(steps: Array, begin: Array, end: Array, args: tuple[float, ...]) -> Array:
    here = (begin < args[0]) & (args[0] <= end)
    return steps - here[:, None] * np.array([args[1], args[2], 0.0])


def _spun(steps: Array, begin: Array, end: Array, args: tuple[float, ...]) -> Array:
    seconds, _ = _share(begin, end, args[0], args[1])
    return steps + seconds[:, None] * np.array([args[2], 0.0, 0.0])


def _dead(steps: Array, begin: Array, end: Array, args: tuple[float, ...]) -> Array:
    _, share = _share(begin, end, args[0], args[1])
    return steps * (1.0 - share)[:, None]


def _mirrored(steps: Array, *_: object) -> Array:
    return steps * np.array([1.0, -1.0, -1.0])


def _forwards_only(steps: Array, *_: object) -> Array:
    return np.where(steps[:, :1] < 0.0, steps * np.array([-1.0, -1.0, 1.0]), steps)


def _scaled(steps: Array, _begin: Array, _end: Array, args: tuple[float, ...]) -> Array:
    return steps * np.array([args[0], args[0], 1.0])


# --- what chance decides ------------------------------------------------------------------------------------------


def _moment(given: tuple[float, ...], duration: float, rng: np.random.Generator, seconds: float = 0.0) -> float:
    latest = duration - MARGIN - seconds
    drawn = float(rng.random())
    if given:
        return given[0]
    if latest <= MARGIN:
        raise MclError(
            f"a log of {duration:.1f} s leaves no place for a fault by chance, {MARGIN:g} s from either end",
            "say when it is to happen",
        )
    return round(MARGIN + drawn * (latest - MARGIN), 3)


def _instant(given: tuple[float, ...], duration: float, rng: np.random.Generator) -> tuple[float, ...]:
    return (_moment(given, duration, rng),)


def _turning(given: tuple[float, ...], duration: float, rng: np.random.Generator) -> tuple[float, ...]:
    degrees = rng.uniform(30.0, 120.0) * rng.choice([-1.0, 1.0])
    return (_moment(given, duration, rng), round(float(degrees), 1))


def _sliding(given: tuple[float, ...], duration: float, rng: np.random.Generator) -> tuple[float, ...]:
    metres, way = rng.uniform(0.5, 3.0), rng.uniform(-np.pi, np.pi)
    dx, dy = (metres * np.cos(way), metres * np.sin(way)) if len(given) < 2 else (given[1], 0.0)
    return (_moment(given, duration, rng), round(float(dx), 3), round(float(dy), 3))


def _lasting(
    shortest: float, longest: float, *further: float
) -> Callable[[tuple[float, ...], float, np.random.Generator], tuple[float, ...]]:
    def drawn(given: tuple[float, ...], duration: float, rng: np.random.Generator) -> tuple[float, ...]:
        seconds = float(rng.uniform(shortest, longest))
        begin = _moment(given, duration, rng, seconds)
        return (begin, round(begin + seconds, 3), *further)

    return drawn


def _for_good(given: tuple[float, ...], duration: float, rng: np.random.Generator) -> tuple[float, ...]:
    return (_moment(given, duration, rng), math.inf)


KINDS: Final[Mapping[str, Kind]] = {
    "gap": Kind(("FROM", "TO"), at=1, drawn=_lasting(10.0, 30.0), wheels=False),
    "carried": Kind(("FROM", "TO"), at=1, change=_carried, drawn=_lasting(10.0, 30.0), wheels=False),
    "turn": Kind(("AT", "DEGREES"), at=0, change=_turned, drawn=_turning),
    "slide": Kind(("AT", "DX", "DY"), at=0, change=_slid, drawn=_sliding),
    "spin": Kind(("FROM", "TO", "SPEED"), at=0, change=_spun, drawn=_lasting(2.0, 2.0, SPINNING)),
    "dead": Kind(("FROM", "TO"), at=0, change=_dead, drawn=_for_good),
    "mirrored": Kind((), change=_mirrored),
    "no-reverse": Kind((), change=_forwards_only),
    "scale": Kind(("FACTOR",), needed=1, change=_scaled),
    "restart": Kind(("AT",), at=0, drawn=_instant),
    "late": Kind(("SECONDS",), needed=1),
    "thin": Kind(("SECONDS",), needed=1, wheels=False),
    "jump": Kind(("AT", "TO"), needed=2, at=0, wheels=False),
}
"""Every kind of fault by its name; docs/faults.md says what each does."""


# --- asking for them ----------------------------------------------------------------------------------------------


def parse_fault(text: str) -> Fault:
    """The fault that a text KIND:ARGS asks for, as in ``turn:40:90``; MclError for any other text."""
    name, *words = text.strip().split(":")
    if name not in KINDS:
        raise MclError(f"no kind of fault {name!r}", meant_or_known(name, KINDS))
    kind = KINDS[name]
    wanted = ":".join([name, *kind.arguments])
    try:
        args = tuple(float(word) for word in words)
    except ValueError:
        args = (math.nan,)
    if not kind.needed <= len(args) <= len(kind.arguments) or not all(map(math.isfinite, args)):
        drawn = "" if kind.needed else "; what is left out at the end is drawn"
        raise MclError(f"{text!r} is not {wanted} in numbers{drawn if kind.arguments else ''}")
    if wrong := _wrong(kind, dict(zip(kind.arguments, args, strict=False))):
        raise MclError(f"{text!r} ({wanted}): {wrong}")
    return Fault(name, args, text.strip())


def placed(faults: Sequence[Fault], duration: float, seed: int) -> tuple[Fault, ...]:
    """The faults with all of their arguments: what was not given, where and how large, follows from the seed.

    ``duration``: of the log, from its first scan to its last, s. Raises MclError for one that lies outside of it.
    """
    result = []
    for k, fault in enumerate(faults):
        kind, args = KINDS[fault.kind], fault.args
        if len(args) < len(kind.arguments) and kind.drawn is not None:
            args += kind.drawn(args, duration, np.random.default_rng([seed, k]))[len(args) :]
        full = Fault(fault.kind, args, fault.name)
        if kind.at is not None and not 0.0 <= full.begin <= duration:
            raise MclError(f"fault {full.text}: the log runs from 0 to {duration:.1f} s")
        if full.moment is not None and full.moment > duration:
            raise MclError(f"fault {full.text}: nothing is left after it, the log ends at {duration:.1f} s")
        result.append(full)
    return tuple(result)


def note(faults: Sequence[Fault]) -> dict[str, str]:
    """The faults, placed, as a record of a log's metadata: for who judges a run, never for the filter."""
    record = {str(k): fault.text for k, fault in enumerate(faults)}
    if carried := [fault.moment for fault in faults if fault.carries_off]:
        record["kidnapped_at"] = json.dumps(carried)
    return record


def noted(metadata: Mapping[str, Mapping[str, str]]) -> tuple[Fault, ...]:
    """The faults that ``note`` put into a log's metadata."""
    record = metadata.get(schema.FAULTS, {})
    return tuple(parse_fault(text) for key, text in record.items() if key.isdecimal())


def _wrong(kind: Kind, given: Mapping[str, float]) -> str:
    for name in ("SECONDS", "FACTOR"):
        if given.get(name, 1.0) <= 0.0:
            return f"{name} must be more than 0"
    lasts_from_the_start = kind.change is _dead
    if given.get("AT", 1.0) <= 0.0 or (given.get("FROM", 1.0) <= 0.0 and not lasts_from_the_start):
        return "it must begin after the first scan, at 0 s"
    if "FROM" in given and given["FROM"] < 0.0:
        return "FROM must not be less than 0"
    if "FROM" in given and given.get("TO", math.inf) <= given["FROM"]:
        return "TO must be later than FROM"
    return ""


# --- making them --------------------------------------------------------------------------------------------------


def told(fault: Fault, times: Array, poses: Array) -> Array:
    """The odometry (n, 3) m, m, rad at ``times`` (n,) s, in order, as wheels with that fault would have told it.

    Up to the fault the numbers are the same to the bit; headings are not wrapped.
    """
    if len(poses) < 2:
        return poses
    if fault.kind == "restart":
        k = int(np.searchsorted(times, fault.args[0]))
        if k == len(poses):
            return poses
        after = between(poses[k], poses[k:])
        return np.concatenate([poses[:k], np.column_stack([after[:, :2], poses[k:, 2] - poses[k, 2]])])
    if fault.kind == "late":
        then = times - fault.args[0]
        columns = (poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2]))
        return np.stack([np.interp(then, times, column) for column in columns], axis=-1)
    steps = between(poses[:-1], poses[1:])
    return reckoned(poses, steps, changed(fault, steps, times[:-1], times[1:]))


def changed(fault: Fault, steps: Array, begin: Array, end: Array) -> Array:
    """Steps (n, 3) of the robot, m, m, rad in its own frame, that begin and end (n,) s, as such wheels tell them."""
    change = KINDS[fault.kind].change
    return steps if change is None else change(steps, begin, end, fault.args)


def reckoned(poses: Array, before: Array, steps: Array) -> Array:
    """Poses (n, 3) whose steps (n - 1, 3) are ``steps`` instead of ``before``; the first ones stay to the bit."""
    differing = np.flatnonzero((before != steps).any(axis=1))
    if not len(differing):
        return poses
    k = int(differing[0])
    yaw = poses[k, 2] + np.concatenate([[0.0], np.cumsum(steps[k:, 2])])
    cos, sin = np.cos(yaw[:-1]), np.sin(yaw[:-1])
    x = poses[k, 0] + np.cumsum(cos * steps[k:, 0] - sin * steps[k:, 1])
    y = poses[k, 1] + np.cumsum(sin * steps[k:, 0] + cos * steps[k:, 1])
    return np.concatenate([poses[: k + 1], np.column_stack([x, y, yaw[1:]])])


def recorded(fault: Fault, times: Array) -> NDArray[np.bool_]:
    """Which of the messages at ``times`` (n,) s, of any sensor, the log still has."""
    if fault.kind not in ("gap", "carried"):
        return np.ones(len(times), dtype=np.bool_)
    return (times < fault.args[0]) | (times > fault.args[1])


def scanned(fault: Fault, times: Array) -> NDArray[np.bool_]:
    """Which of the scans at ``times`` (n,) s, in order, the log still has."""
    if fault.kind != "thin":
        return recorded(fault, times)
    kept, last = np.zeros(len(times), dtype=np.bool_), -math.inf
    for k, time in enumerate(times.tolist()):
        if time - last >= fault.args[0]:
            kept[k], last = True, time
    return kept


def wrapped(poses: Array) -> Array:
    """The poses (n, 3) with headings within [-pi, pi)."""
    return np.column_stack([poses[:, :2], wrap_angle(poses[:, 2])])
