"""The one exception that users are meant to see: a message that says what is wrong, and a hint that says what to do."""

from __future__ import annotations

from pathlib import Path

from pipeline.printable import one_line


class MclError(Exception):
    """Bad input or an impossible request, told in one line.

    ``message`` says what is wrong and what was expected, ``hint`` what to do about it;
    ``path`` and ``line`` (1-based) name the place in a text input. The command line prints
    ``str(error)`` and exits with 1; library code never exits.
    """

    def __init__(
        self, message: str, hint: str = "", *, path: Path | str | None = None, line: int | None = None
    ) -> None:
        self.message = message
        self.hint = hint
        self.path = path
        self.line = line
        super().__init__(str(self))

    def __str__(self) -> str:
        place = "" if self.path is None else f"{self.path}:{self.line}: " if self.line is not None else f"{self.path}: "
        hint = f" ({self.hint})" if self.hint else ""
        return one_line(f"{place}{self.message}{hint}")
