from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from right_files import lesson_of

from pipeline.lessons import lesson
from pipeline.lessons.judging import Judgement, judge


@pytest.fixture
def judged(tmp_path: Path) -> Callable[..., Judgement]:
    """Judges a text as if it were somebody's file."""

    def run(source: str, name: str | None = None, **options: object) -> Judgement:
        path = tmp_path / "mine.py"
        path.write_text(source)
        found = lesson_of(source) if name is None else lesson(name)
        return judge(found, path, **options)  # type: ignore[arg-type]

    return run
