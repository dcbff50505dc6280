"""What was probably meant by a name that is unknown."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

AS_NEAR = 0.02
"""Difference of difflib's ratios below which two names are as near as one another: then both are named."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """A question that names the nearest of the ``known`` names, or the two that are as near, as the hint of an error;
    empty if none is near."""
    near = difflib.get_close_matches(word, list(known), n=2)
    alike = near[:1] + [name for name in near[1:] if _ratio(word, name) > _ratio(word, near[0]) - AS_NEAR]
    return f"did you mean {' or '.join(map(repr, alike))}?" if near else ""


def meant_or_known(word: str, known: Iterable[str]) -> str:
    """The same, and a list of all that is known where none is near."""
    names = list(known)
    return did_you_mean(word, names) or f"there {'are' if len(names) > 1 else 'is only'} {', '.join(names)}"


def _ratio(word: str, name: str) -> float:
    return difflib.SequenceMatcher(None, name, word).ratio()
