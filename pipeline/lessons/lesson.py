"""What a lesson is: a function of the book to be written, questions that its answers are judged by, and wrong ways."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.lessons.exam import Exam, Function


@dataclass(frozen=True, eq=False)
class Mistake:
    """A wrong way to write it: ``text`` says in a clause what is wrong.

    ``changes``: pieces of the reference's source, each of which stands there once, and what is in their place then.
    """

    text: str
    changes: Mapping[str, str]


@dataclass(frozen=True, eq=False)
class Lesson:
    """One task: ``name`` is the number of the book's table where there is one, ``source`` says where it is told.

    ``task``: what the starter file says about it, in whole sentences; ``reference``: the function, in plain NumPy,
    whose name, parameters and docstring the starter takes over; ``exam``: what is asked of a function, and what is
    right; ``mistakes``: what is tried when an answer is wrong.
    """

    name: str
    title: str
    source: str
    task: str
    reference: Function
    exam: Exam
    mistakes: tuple[Mistake, ...]

    @property
    def function(self) -> str:
        """The name of the function to be written."""
        return str(self.reference.__name__)

    def starter(self, path: Path | str) -> str:
        """The text of a starter file that will be ``path``."""
        names = ", ".join(inspect.signature(self.reference).parameters)
        signature = f"def {self.function}({names}):"
        if len(signature) > 100:
            names = textwrap.fill(names, 96, initial_indent="    ", subsequent_indent="    ")
            signature = f"def {self.function}(\n{names}\n):"
        task = textwrap.fill(self.task, 100, break_on_hyphens=False)
        check = f"mcl lesson {self.name} --check {Path(path).as_posix()}"
        return (
            f'"""Lesson {self.name}: {self.title}.\n\n{self.source}.\n\n{task}\n\n'
            f"Write the function below, and check it with\n\n    {check}\n"
            f'"""\n\nimport numpy as np\n\n\n{signature}\n'
            f"{textwrap.indent(self._docstring(), '    ')}\n"
            f'    raise NotImplementedError("{self.function} is yours to write")\n'
        )

    def mistaken(self, *mistakes: Mistake) -> Function:
        """The reference with these mistakes in it."""
        changes = {old: new for mistake in mistakes for old, new in mistake.changes.items()}
        return changed(self.reference, changes)

    def _docstring(self) -> str:
        return f'"""{inspect.getdoc(self.reference)}\n"""'


def changed(function: Callable[..., Any], changes: Mapping[str, str]) -> Function:
    """The same function with pieces of its source replaced, each of which must stand there exactly once."""
    source = _without_docstring(textwrap.dedent(inspect.getsource(function)))
    for old in changes:
        if source.count(old) != 1:
            raise ValueError(f"{function.__name__}: {old!r} stands there {source.count(old)} times")
    source = re.sub("|".join(map(re.escape, changes)), lambda found: changes[found[0]], source)
    names = dict(function.__globals__)
    exec(compile(source, f"<{function.__name__}, changed>", "exec"), names)
    made: Function = names[function.__name__]
    return made


def _without_docstring(source: str) -> str:
    (function,) = ast.parse(source).body
    assert isinstance(function, ast.FunctionDef)
    told, lines = function.body[0], source.splitlines(keepends=True)
    return "".join(lines[: told.lineno - 1] + lines[told.end_lineno :])
