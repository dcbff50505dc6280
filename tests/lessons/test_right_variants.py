"""Whoever is right is told so: by loops or arrays, in single precision, with other names, by other formulas."""

from __future__ import annotations

from pathlib import Path

import pytest
from right_files import RIGHT, lesson_of

from pipeline.lessons import lessons
from pipeline.lessons.judging import judge

FILES = sorted(RIGHT.glob("*.py"))


def test_there_are_enough_of_them():
    told = [lesson_of(path.read_text()) for path in FILES]
    assert len(FILES) >= 20
    assert all(told.count(each) >= 2 for each in lessons())


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_none_is_flagged(path: Path):
    judgement = judge(lesson_of(path.read_text()), path)
    assert not [group for group in judgement.groups if group.wrong]
    assert judgement.log_right, (judgement.outcome, judgement.reference, judgement.stopped)
    assert judgement.right
