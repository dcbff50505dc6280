"""The colours of pictures on paper and on a dark slide, by what they mean; text reaches WCAG's AA on every ground."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.recording import palette
from pipeline.recording.palette import Colour


@dataclass(frozen=True)
class Theme:
    """``ground``: behind everything; ``ink``: text; ``muted``: text of less weight; ``pale``: lines that only help.

    ``floor``, ``wall`` and ``unknown``: grey levels of the map; ``around``: of its unknown in a figure, nearer the
    ground; ``weights`` (16, 3): of particles, from light to heavy, away from the floor; ``runs``: of runs side by side;
    ``name_of_share``: of the text at a hypothesis; the others are named as in ``pipeline.recording.palette``.
    """

    ground: Colour
    ink: Colour
    muted: Colour
    pale: Colour
    floor: int
    wall: int
    unknown: int
    around: int
    weights: NDArray[np.uint8]
    runs: tuple[Colour, ...]
    hit: Colour
    short: Colour
    long: Colour
    expected: Colour
    no_return: Colour
    estimate: Colour
    truth: Colour
    hypothesis: Colour
    name_of_share: Colour
    hindsight: Colour
    curve: Colour

    @property
    def tones(self) -> NDArray[np.uint8]:
        """(256,) what a cell of the recorded map, black where it is occupied, is drawn with."""
        free = np.arange(256) / 255.0
        tones = np.round(self.wall + (self.floor - self.wall) * free)
        tones[palette.UNKNOWN[0]] = self.unknown
        return tones.astype(np.uint8)


THEMES: Mapping[str, Theme] = {
    "print": Theme(
        ground=(255, 255, 255),
        ink=palette.LETTERING,
        muted=(110, 110, 110),
        pale=(200, 200, 200),
        floor=255,
        wall=0,
        unknown=palette.UNKNOWN[0],
        around=235,
        weights=palette.WEIGHT_COLOURS,
        runs=palette.RUNS,
        hit=palette.HIT,
        short=palette.SHORT,
        long=palette.LONG,
        expected=palette.EXPECTED,
        no_return=palette.NO_RETURN,
        estimate=palette.ESTIMATE,
        truth=palette.TRUTH,
        hypothesis=palette.HYPOTHESIS,
        name_of_share=(150, 25, 95),
        hindsight=palette.HINDSIGHT,
        curve=palette.CURVE,
    ),
    "dark": Theme(
        ground=(18, 18, 18),
        ink=(238, 238, 238),
        muted=(175, 175, 175),
        pale=(85, 85, 85),
        floor=30,
        wall=165,
        unknown=58,
        around=52,
        weights=palette.WEIGHT_COLOURS[::-1],
        runs=((86, 180, 233), (240, 130, 50), (0, 190, 140), (225, 150, 195), (120, 150, 255), (240, 200, 60)),
        hit=(90, 165, 245),
        short=(245, 135, 45),
        long=(225, 225, 225),
        expected=(245, 205, 0),
        no_return=(120, 120, 120),
        estimate=(255, 95, 175),
        truth=(60, 215, 165),
        hypothesis=(240, 150, 200),
        name_of_share=(255, 165, 215),
        hindsight=(86, 180, 233),
        curve=(240, 150, 50),
    ),
}
"""By what ``--theme`` calls them."""


def theme(name: str) -> Theme:
    """The theme of this name; MclError if there is none."""
    if name not in THEMES:
        raise MclError(f"there is no theme {name!r}", f"name one of {', '.join(THEMES)}")
    return THEMES[name]
