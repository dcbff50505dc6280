"""How large a picture is to be: in millimetres of paper, by name or by number, or in pixels."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from pipeline.errors import MclError

WIDTHS: Mapping[str, float] = {"column": 84.0, "page": 174.0}
"""mm: a column, and the whole width, of a page in two columns, as IEEE and Springer print it."""
MM_PER_INCH = 25.4
SMALLEST, LARGEST = 240, 7680
"""Pixels along a side."""
NARROWEST, WIDEST = 40.0, 1000.0
"""mm along a side."""


@dataclass(frozen=True)
class Size:
    """``width`` and ``height`` in ``unit``, "px" or "mm"; without a height a figure takes what it needs."""

    width: float
    height: float | None
    unit: str

    def inches(self, dpi: float) -> tuple[float, float | None]:
        """Width and height on paper, of pixels at so many an inch."""
        per_inch = dpi if self.unit == "px" else MM_PER_INCH
        return self.width / per_inch, None if self.height is None else self.height / per_inch


def size_of(asked: str | tuple[int, int]) -> Size:
    """``column``, ``page``, millimetres like ``84x60mm``, or pixels like ``1280x720``. Raises MclError for others."""
    if not isinstance(asked, str):
        return _within(Size(*asked, "px"))
    if asked in WIDTHS:
        return Size(WIDTHS[asked], None, "mm")
    found = re.fullmatch(r"(\d+)x(\d+)(mm)?", asked.lower())
    if not found:
        raise MclError(
            f"{asked!r} is no size",
            "column and page are widths of a paper; else WIDTHxHEIGHT, in pixels like 1280x720, or like 84x60mm",
        )
    return _within(Size(int(found[1]), int(found[2]), found[3] or "px"))


def _within(size: Size) -> Size:
    low, high, said = (SMALLEST, LARGEST, "pixels") if size.unit == "px" else (NARROWEST, WIDEST, "millimetres")
    assert size.height is not None, "both sides are named"
    if not all(low <= side <= high for side in (size.width, size.height)):
        raise MclError(f"a picture has {low:g} to {high:g} {said} along a side")
    return size
