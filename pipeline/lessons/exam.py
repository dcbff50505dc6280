"""What is asked of a function: many numbers, what each of them should be, and how far from it is still right."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.geometry import wrap_angle

Array = NDArray[np.float64]
Function = Callable[..., Any]

RELATIVE = 1e-3
"""Share by which an answer may differ from the right one: single precision is right as well."""


@dataclass(frozen=True)
class Question:
    """One number that is asked for: ``text`` names it, ``group`` says what it has in common with others."""

    group: str
    text: str
    unit: str = ""
    angle: bool = False


class Unusable(Exception):  # noqa: N818 - it is not an error of ours
    """What a function returned cannot be read as an answer; ``arguments`` are those that it was called with."""

    def __init__(self, text: str, arguments: Sequence[Any]) -> None:
        super().__init__(text)
        self.arguments = arguments


class Exam(Protocol):
    """Questions (m,), what the answers should be (m,), how far off they may be (m,), and how a function is asked."""

    @property
    def questions(self) -> Sequence[Question]:
        """What each number is."""
        ...

    @property
    def expected(self) -> Array:
        """What it should be."""
        ...

    @property
    def tolerance(self) -> Array:
        """By how much it may differ."""
        ...

    def ask(self, function: Function) -> Array:
        """The function's answers (m,). Raises Unusable."""
        ...


@dataclass(frozen=True)
class Returned:
    """One of the things that a function returns: its name, its unit, and which of its numbers are ``angles``, which may
    differ by whole turns."""

    name: str
    unit: str = ""
    angles: tuple[int, ...] = ()


@dataclass(frozen=True)
class Case:
    """Arguments to call a function with; ``rows`` name the numbers of what it returns, where it returns one array."""

    group: str
    arguments: tuple[Any, ...]
    rows: tuple[str, ...] = ()


class Exact:
    """An exam of a function whose answers are determined: in every case they must be those of the reference."""

    def __init__(
        self, reference: Function, returns: Sequence[Returned], cases: Sequence[Case], *, least: float = 1e-6
    ) -> None:
        """``least``: a difference that never counts, in the answer's unit."""
        self._reference, self._returns, self._cases, self._least = reference, returns, cases, least

    @cached_property
    def _right(self) -> list[list[Array]]:
        return [self._parts(self._reference(*copies(case.arguments)), case) for case in self._cases]

    @cached_property
    def questions(self) -> Sequence[Question]:
        """What each number is."""
        asked = []
        for case, parts in zip(self._cases, self._right, strict=True):
            for returned, part in zip(self._returns, parts, strict=True):
                names = case.rows or _indices(returned.name, part.shape)
                asked += [
                    Question(case.group, name, returned.unit, k in returned.angles) for k, name in enumerate(names)
                ]
        return asked

    @cached_property
    def expected(self) -> Array:
        """What the reference returns."""
        return np.concatenate([part.reshape(-1) for parts in self._right for part in parts])

    @cached_property
    def tolerance(self) -> Array:
        """A share of what is expected, and never less than the difference that does not count."""
        return self._least + RELATIVE * np.abs(self.expected)

    def ask(self, function: Function) -> Array:
        """The function's answers (m,). Raises Unusable if it returns anything of another shape than the reference."""
        answers = []
        for case, parts in zip(self._cases, self._right, strict=True):
            found = self._parts(called(function, case.arguments), case)
            for returned, right, part in zip(self._returns, parts, found, strict=True):
                answers.append(shaped(part, right.shape, returned.name, case.arguments).reshape(-1))
        return np.concatenate(answers)

    def _parts(self, result: Any, case: Case) -> list[Array]:
        names = [returned.name for returned in self._returns]
        if len(names) == 1:
            return [numbers(result, names[0], case.arguments)]
        if not isinstance(result, tuple | list) or len(result) != len(names):
            got = f"{len(result)} things" if isinstance(result, tuple | list) else kind_of(result)
            raise Unusable(
                f"it should return {len(names)} things, {', '.join(names)}, and returned {got}", case.arguments
            )
        return [numbers(part, name, case.arguments) for part, name in zip(result, names, strict=True)]


def called(function: Function, arguments: Sequence[Any]) -> Any:
    """What the function returns for copies of the arguments: it may do with them what it likes."""
    with np.errstate(all="ignore"):
        return function(*copies(arguments))


def copies(arguments: Sequence[Any]) -> list[Any]:
    """The arguments, arrays copied."""
    return [a.copy() if isinstance(a, np.ndarray) else a for a in arguments]


def numbers(result: Any, name: str, arguments: Sequence[Any]) -> Array:
    """What was returned as float64, of whatever kind its numbers are. Raises Unusable if they are none."""
    try:
        found = np.asarray(result)
        if found.dtype.kind not in "fiub":
            raise TypeError
        return found.astype(np.float64)
    except (TypeError, ValueError):
        raise Unusable(f"{name} should be numbers, and it returned {kind_of(result)}", arguments) from None


def shaped(found: Array, shape: tuple[int, ...], name: str, arguments: Sequence[Any]) -> Array:
    """The same, if it has this shape (a single number may be an array of one) and no NaN. Raises Unusable if not."""
    if found.shape != shape and not (found.size == 1 and shape == ()):
        raise Unusable(f"{name} should have the shape {shape}, and has {found.shape}", arguments)
    if np.isnan(found).any():
        bad = np.argwhere(np.isnan(found))
        where = f" at {bad[0].tolist()}" if found.ndim else ""
        raise Unusable(f"{name} is not a number (NaN){where}", arguments)
    return found


def kind_of(result: Any) -> str:
    """What it is, in a word or two."""
    return "nothing" if result is None else f"a {type(result).__name__}"


def apart(questions: Sequence[Question], answers: ArrayLike, others: ArrayLike) -> Array:
    """Differences (m,) between two sets of answers; whole turns count for nothing where angles are asked for."""
    with np.errstate(invalid="ignore"):  # infinity minus infinity
        difference = np.asarray(answers, np.float64) - np.asarray(others, np.float64)
    angles = np.array([question.angle for question in questions])
    return np.where(angles, wrap_angle(np.where(angles, difference, 0.0)), difference)


def _indices(name: str, shape: tuple[int, ...]) -> list[str]:
    return [name] if shape == () else [f"{name}{list(index)}" for index in np.ndindex(shape)]
