"""Whether a function is right, where it is not, by how much, and which mistake that could be."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.filter.substeps import SubStep
from pipeline.lessons import lessons
from pipeline.lessons.exam import RELATIVE, Array, Function, Question, Unusable, apart
from pipeline.lessons.lesson import Lesson, Mistake
from pipeline.lessons.on_log import RUNS, Outcome
from pipeline.lessons.written import Written, within

Flags = NDArray[np.bool_]

LIKELIEST = 5
"""Mistakes of which two at once are tried."""
PATIENCE = 30.0
"""Seconds that all questions, and the log, may take each."""


@dataclass(frozen=True)
class Wrong:
    """An answer that is not right."""

    question: Question
    answer: float
    expected: float


@dataclass(frozen=True)
class Group:
    """Questions that have something in common: how many there are, and which were answered wrongly, the worst first."""

    name: str
    asked: int
    wrong: tuple[Wrong, ...]


@dataclass(frozen=True)
class Judgement:
    """What came out: ``groups`` in the order of asking.

    ``mistakes``: those that explain all wrong answers together, or the one that explains most of them, ``explained`` of
    ``differing``; ``relation``: what all wrong answers have to do with the right ones, empty if that is nothing simple.
    On the log: ``outcome`` and that of the reference, None if it was not tried, and ``stopped``: why it
    came to no end.
    """

    lesson: Lesson
    path: Path
    groups: tuple[Group, ...]
    mistakes: tuple[Mistake, ...]
    relation: str
    explained: int
    differing: int
    outcome: Outcome | None
    reference: Outcome | None
    stopped: str = ""

    @property
    def answers_right(self) -> bool:
        """Whether every question was answered rightly."""
        return not any(group.wrong for group in self.groups)

    @property
    def log_right(self) -> bool:
        """Whether the log was gone through as well as with the reference."""
        if self.outcome is None or self.reference is None:
            return not self.stopped
        return self.outcome.as_good_as(self.reference)

    @property
    def right(self) -> bool:
        """Whether there is nothing to be mended."""
        return self.answers_right and self.log_right

    def to_dict(self) -> dict[str, Any]:
        """As plain values."""
        return {
            "lesson": self.lesson.name,
            "file": str(self.path),
            "right": self.right,
            "groups": [
                {
                    "name": group.name,
                    "asked": group.asked,
                    "wrong": [
                        {"what": w.question.text, "unit": w.question.unit, "answer": w.answer, "expected": w.expected}
                        for w in group.wrong
                    ],
                }
                for group in self.groups
            ],
            "mistakes": [mistake.text for mistake in self.mistakes],
            "relation": self.relation,
            "explained": self.explained,
            "differing": self.differing,
            "log": None
            if self.outcome is None or self.reference is None
            else {"yours": self.outcome.value, "reference": self.reference.value, "text": self.outcome.text},
            "stopped": self.stopped,
        }


def judge(lesson: Lesson, path: Path, *, patience: float = PATIENCE, always_on_log: bool = True) -> Judgement:
    """Ask the function of a file all the lesson's questions, and try it on the log.

    ``always_on_log``: also if an answer was wrong. Raises MclError, with file and line, if the file cannot be loaded,
    or the function cannot be called as the lesson has it, or returns something else than it should.
    """
    with within(patience, path, lesson.function):
        written = Written(path, lesson.function)
        answers = _asked(lesson, written)
    off, differs = _differences(lesson, answers)
    mistakes, explained = explanation(lesson, answers)
    outcome, reference, stopped = None, None, ""
    if always_on_log or not differs.any():
        try:
            with within(patience, path, lesson.function):
                outcome = run_on_log(lesson, written)
            reference = reference_on_log(lesson)
        except MclError as error:
            stopped = str(error)
        except Exception as error:  # a filter that is fed nonsense
            stopped = f"{type(error).__name__}: {error}"
    groups = _groups(lesson, answers, off, differs)
    relation = _relation(answers[differs], lesson.exam.expected[differs])
    differing = int(differs.sum())
    return Judgement(lesson, path, groups, mistakes, relation, explained, differing, outcome, reference, stopped)


def run_on_log(lesson: Lesson, function: Function, steps: list[SubStep] | None = None) -> Outcome:
    """The lesson's piece of the embedded drive with this function; its sub-steps go into ``steps``."""
    parts = {each.function: each.reference for each in lessons()} | {lesson.function: function}
    with np.errstate(all="ignore"):
        return RUNS[lesson.name](parts, steps.append if steps is not None else lambda _: None)


@cache
def reference_on_log(lesson: Lesson) -> Outcome:
    """The same with the lesson's own function."""
    return run_on_log(lesson, lesson.reference)


def _asked(lesson: Lesson, written: Written) -> Array:
    """The function's answers; MclError where they are none."""
    try:
        answers = lesson.exam.ask(written)
    except Unusable as error:
        line = written.returned_at(error.arguments)
        raise MclError(str(error), _like_this(lesson, error), path=written.path, line=line) from error
    except MclError as error:
        if hint := _like_this(lesson, error.__cause__):
            raise MclError(error.message, hint, path=error.path, line=error.line) from error
        raise
    return answers


def _like_this(lesson: Lesson, error: BaseException | None) -> str:
    """A mistake that fails in the same way, if there is one."""
    for mistake in lesson.mistakes:
        told = _answers(lesson, mistake)
        if isinstance(told, Exception) and type(told) is type(error) and str(told) == str(error):
            return f"as it happens when {mistake.text}"
    return ""


@cache
def _answers(lesson: Lesson, *mistakes: Mistake) -> Array | Exception:
    """What the reference answers with these mistakes in it; what it raises, if it does."""
    try:
        function = lesson.mistaken(*mistakes)
        return lesson.exam.ask(function)
    except Exception as error:
        return error


def _differences(lesson: Lesson, answers: Array) -> tuple[Array, Flags]:
    """(m,) how far the answers are from the right ones, in tolerances, and which of them are wrong."""
    exam = lesson.exam
    off = np.abs(apart(exam.questions, answers, exam.expected)) / exam.tolerance
    return off, ~np.less_equal(off, 1.0)


def explanation(lesson: Lesson, answers: Array) -> tuple[tuple[Mistake, ...], int]:
    """The mistake, or two of them together, that give these answers, and how many of the wrong ones that explains.

    Where there is none, the mistake that gives most of the wrong answers, and of the right ones too.
    """
    _, differs = _differences(lesson, answers)
    if not (wrong := int(differs.sum())):
        return (), 0
    alone = {mistake: _alike(lesson, answers, mistake) for mistake in lesson.mistakes}
    if whole := [mistake for mistake, alike in alone.items() if alike.all()]:
        return (min(whole, key=lambda mistake: _distance(lesson, answers, mistake)),), wrong
    # Two mistakes at once: either of them alone gives some of the answers that are wrong.
    some = [mistake for mistake, alike in alone.items() if (alike & differs).any()]
    some = sorted(some, key=lambda mistake: -int(alone[mistake].sum()))
    for pair in _pairs(some[:LIKELIEST]):
        if _alike(lesson, answers, *pair).all():
            return pair, wrong
    if some and alone[some[0]].sum() > (~differs).sum() and (alone[some[0]] & differs).sum() >= wrong / 2:
        return (some[0],), int((alone[some[0]] & differs).sum())
    return (), 0


FACTORS = {
    -1.0: "the sign is wrong",
    180.0 / np.pi: "degrees, where radians should be?",
    np.pi / 180.0: "radians, where degrees should be?",
    100.0: "centimetres, or per cent?",
    0.01: "is something taken for centimetres, or for per cent?",
    2.0: "twice as much as it should be",
    0.5: "half of what it should be",
    np.sqrt(2.0 * np.pi): "a factor of the square root of 2 pi",
    1.0 / np.sqrt(2.0 * np.pi): "a factor of the square root of 2 pi",
}
"""What it may be if all wrong answers are so many times what they should be."""


def _relation(answers: Array, expected: Array) -> str:
    """What all wrong answers (k,) have to do with the right ones, in a sentence; empty for fewer than three of them."""
    if len(answers) < 3:
        return ""
    if not np.isfinite(answers).any():
        return "none of the wrong answers is a number"
    if np.ptp(answers) == 0.0:
        return f"the wrong answers are all {answers[0]:.4g}"
    with np.errstate(all="ignore"):
        simple = {
            "one over": 1.0 / expected,
            "the logarithm of": np.log(expected),
            "the square of": expected**2,
            "the square root of": np.sqrt(expected),
        }
        for text, made in simple.items():
            if np.allclose(answers, made, rtol=1e-2, atol=0.0):
                return f"the wrong answers are all {text} what they should be"
        factors = answers / expected
    if not np.isfinite(factors).all() or np.ptp(factors) > 1e-2 * abs(factors[0]):
        return ""
    factor = float(np.median(factors))
    known = next((text for value, text in FACTORS.items() if np.isclose(value, factor, rtol=1e-2)), "")
    return f"the wrong answers are all {factor:.4g} times what they should be" + (f": {known}" if known else "")


def _pairs(mistakes: list[Mistake]) -> Iterator[tuple[Mistake, Mistake]]:
    for a, b in itertools.combinations(mistakes, 2):
        if not a.changes.keys() & b.changes.keys():
            yield a, b


def _alike(lesson: Lesson, answers: Array, *mistakes: Mistake) -> Flags:
    """(m,) which answers are those that these mistakes give, as far as chance and rounding allow."""
    told = _answers(lesson, *mistakes)
    if isinstance(told, Exception):
        return np.zeros(len(answers), np.bool_)
    near = 1.5 * lesson.exam.tolerance + RELATIVE * np.abs(told)
    difference = apart(lesson.exam.questions, answers, told)
    return (np.abs(difference) <= near) | (answers == told) | (np.isnan(answers) & np.isnan(told))


def _distance(lesson: Lesson, answers: Array, mistake: Mistake) -> float:
    """How far the answers are from those that this mistake gives, all of them together."""
    told = _answers(lesson, mistake)
    assert not isinstance(told, Exception)
    return float(np.nansum(np.abs(apart(lesson.exam.questions, answers, told)) / lesson.exam.tolerance))


def _groups(lesson: Lesson, answers: Array, times: Array, differs: Flags) -> tuple[Group, ...]:
    questions, expected = lesson.exam.questions, lesson.exam.expected
    names = list(dict.fromkeys(question.group for question in questions))
    groups = []
    for name in names:
        at = [k for k, question in enumerate(questions) if question.group == name]
        wrong = sorted((k for k in at if differs[k]), key=lambda k: -np.nan_to_num(times[k], nan=np.inf))
        told = tuple(Wrong(questions[k], float(answers[k]), float(expected[k])) for k in wrong)
        groups.append(Group(name, len(at), told))
    return tuple(groups)
