"""What was probably meant by a name that is unknown."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """A question that names the nearest of the ``known`` names, as the hint of an error; empty if none is near."""
    near = difflib.get_close_matches(word, list(known), n=1)
    return f"did you mean {near[0]!r}?" if near else ""


def meant_or_known(word: str, known: Iterable[str]) -> str:
    """The same, and a list of all that is known where none is near."""
    names = list(known)
    return did_you_mean(word, names) or f"there are {', '.join(names)}"
