"""What every lesson promises: a starter, a reference that passes its own exam, mistakes that are told apart."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.errors import MclError
from pipeline.lessons import lesson, lessons
from pipeline.lessons.exam import Unusable, apart
from pipeline.lessons.judging import explanation, reference_on_log
from pipeline.lessons.lesson import Lesson, Mistake, changed

NAMES = [each.name for each in lessons()]
MISTAKES = [(each, mistake) for each in lessons() for mistake in each.mistakes]


def test_there_are_the_lessons_of_the_course():
    assert NAMES == ["4.4", "ess", "5.5", "5.6", "6.1", "rays", "6.3", "7.2", "8.1", "8.3", "8.4"]
    assert len({each.function for each in lessons()}) == len(NAMES)


def test_a_name_that_is_none_lists_those_that_are():
    with pytest.raises(MclError, match=r"no lesson '9\.9' .*6\.1.*rays"):
        lesson("9.9")


@pytest.mark.parametrize("name", NAMES)
def test_a_starter_is_python_that_is_not_written_yet(name, judged):
    starter = lesson(name).starter("mine.py")
    line = 1 + starter[: starter.index("    raise NotImplementedError")].count("\n")
    with pytest.raises(MclError, match=rf"mine\.py:{line}: .* is not written yet"):
        judged(starter)
    assert f"mcl lesson {name} --check mine.py" in starter
    assert max(map(len, starter.splitlines())) <= 120


@pytest.mark.parametrize("name", NAMES)
def test_a_reference_passes_its_own_exam(name):
    exam = lesson(name).exam
    answers = exam.ask(lesson(name).reference)
    assert len(exam.questions) == len(exam.expected) == len(exam.tolerance) == len(answers)
    # Chance must be far from deciding: the tolerance is six standard errors where there is any.
    assert (np.abs(apart(exam.questions, answers, exam.expected)) < 0.7 * exam.tolerance).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_reference_finds_its_way_on_the_log(name):
    outcome = reference_on_log(lesson(name))
    assert outcome.value <= (3.0 if name == "8.3" else 0.3)  # scans, metres


@pytest.mark.parametrize(
    ("found", "mistake"), MISTAKES, ids=[f"{found.name}: {mistake.text}" for found, mistake in MISTAKES]
)
def test_a_mistake_is_found_and_named(found: Lesson, mistake: Mistake):
    try:
        answers = found.exam.ask(found.mistaken(mistake))
    except (Unusable, ArithmeticError, IndexError):
        return  # it cannot even be asked, which is told as well
    named, explained = explanation(found, answers)
    assert named == (mistake,)
    assert explained > 0


def test_two_mistakes_at_once_are_both_named():
    found = lesson("6.1")
    texts = (
        "p_short is not normalised over 0 to z*",
        "p_max is left out: what came back from nowhere has no likelihood",
    )
    two = tuple(mistake for mistake in found.mistakes if mistake.text in texts)
    assert len(two) == 2
    named, _ = explanation(found, found.exam.ask(found.mistaken(*two)))
    assert named == two


def test_a_change_must_stand_in_the_source_once():
    with pytest.raises(ValueError, match="stands there 0 times"):
        changed(lesson("6.1").reference, {"no such text": ""})
