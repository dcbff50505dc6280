"""A function that somebody else wrote: loaded from its file, called with care, what goes wrong told by line."""

from __future__ import annotations

import signal
import sys
import threading
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType, ModuleType, TracebackType
from typing import Any

from pipeline.errors import MclError
from pipeline.lessons.exam import called


class _TooLong(BaseException):
    """The time is over. No Exception, so that no ``except Exception`` in the file can swallow it."""


class Written:
    """A function of a file. Calling it raises MclError, with file and line, for whatever goes wrong in it."""

    def __init__(self, path: Path, name: str) -> None:
        self.path, self.name = path, name
        self._function = self._load()

    def __call__(self, *arguments: Any) -> Any:
        """What it returns; it gets copies of the arguments."""
        try:
            return called(self._function, arguments)
        except NotImplementedError as error:
            raise self._told(error, f"{self.name} is not written yet", "replace the line that raises this") from error
        except Exception as error:
            raise self._told(error, f"{type(error).__name__}: {error}") from error

    def returned_at(self, arguments: Sequence[Any]) -> int | None:
        """The line that the function returns from when it is called so; where it begins, if that cannot be told."""
        code = getattr(self._function, "__code__", None)
        line: int | None = getattr(code, "co_firstlineno", None)

        def follow(frame: FrameType, event: str, _: Any) -> Any:
            nonlocal line
            if frame.f_code is not code:
                return None
            if event == "return":
                line = frame.f_lineno
            return follow

        before = sys.gettrace()
        sys.settrace(follow)
        try:
            self(*arguments)
        except MclError:
            pass
        finally:
            sys.settrace(before)
        return line

    def _load(self) -> Any:
        try:
            source = self.path.read_text(encoding="utf-8")
        except UnicodeDecodeError as error:
            raise MclError("not a text file", "expected a Python file", path=self.path) from error
        module = ModuleType(f"lesson_{self.path.stem}")
        module.__file__ = str(self.path)
        names, folder = vars(module), str(self.path.parent.resolve())
        sys.modules[module.__name__] = module  # dataclasses look there
        sys.path.insert(0, folder)
        try:
            exec(compile(source, str(self.path), "exec"), names)
        except SyntaxError as error:
            raise MclError(f"this is no Python: {error.msg}", path=self.path, line=error.lineno) from error
        except Exception as error:
            raise self._told(error, f"{type(error).__name__}: {error}") from error
        except SystemExit as error:
            raise self._told(error, "the file ends the program while it is loaded") from error
        finally:
            sys.path.remove(folder)
        if not callable(names.get(self.name)):
            defined = [name for name, value in names.items() if callable(value) and not name.startswith("_")]
            there = f"; it defines {', '.join(defined)}" if defined else ""
            raise MclError(f"there is no function {self.name} in this file{there}", path=self.path)
        return names[self.name]

    def _told(self, error: BaseException, text: str, hint: str = "") -> MclError:
        return MclError(text, hint, path=self.path, line=_line_in(str(self.path), error.__traceback__))


@contextmanager
def within(seconds: float, path: Path, name: str) -> Iterator[None]:
    """What the function ``name`` of a file does in here is stopped when it takes longer, where the system can do that.

    Raises MclError with the line that it was at.
    """
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def over(*_: Any) -> None:
        raise _TooLong

    before = signal.signal(signal.SIGALRM, over)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    except _TooLong as error:
        line = _line_in(str(path), error.__traceback__)
        hint = "is there a loop that does not end?"
        raise MclError(f"{name} was still busy after {seconds:g} s", hint, path=path, line=line) from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _line_in(path: str, trace: TracebackType | None) -> int | None:
    """The innermost line of this file on the way to an error."""
    lines = [frame.lineno for frame in traceback.extract_tb(trace) if frame.filename == path]
    return lines[-1] if lines else None
