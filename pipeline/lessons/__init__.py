"""Lessons along Probabilistic Robotics: functions to be written by students, and judged."""

from __future__ import annotations

from functools import cache
from importlib import import_module

from pipeline.errors import MclError
from pipeline.lessons.lesson import Lesson
from pipeline.spelling import meant_or_known

_MODULES = (
    "low_variance",
    "sample_size",
    "motion_density",
    "motion_sampling",
    "beam_model",
    "ray_casting",
    "likelihood_field",
    "ekf",
    "grid",
    "augmented",
    "kld",
)
"""In the order of the book."""


@cache
def lessons() -> tuple[Lesson, ...]:
    """All lessons, in the order of the book."""
    return tuple(import_module(f"{__name__}.{name}").LESSON for name in _MODULES)


def lesson(name: str) -> Lesson:
    """The lesson of this name. Raises MclError, with the names that there are."""
    for each in lessons():
        if each.name == name:
            return each
    raise MclError(f"there is no lesson {name!r}", meant_or_known(name, [each.name for each in lessons()]))
