"""The colours, chosen to survive colour-blindness: viridis for weights; blue, vermilion and black for beams.

Nothing is told by hue alone: weights and beams differ in lightness too, what a beam should have done is a dot.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Colour = tuple[int, int, int]

HIT: Colour = (0, 114, 178)
SHORT: Colour = (213, 94, 0)
LONG: Colour = (30, 30, 30)
THROUGH: Colour = (150, 110, 220)  # the same as a curve, which black would not be on a dark theme
EXPECTED: Colour = (245, 205, 0)  # lies on walls, which are dark
CURVE: Colour = (230, 120, 0)
NO_RETURN: Colour = (150, 150, 150)
ESTIMATE: Colour = (204, 0, 110)
TRUTH: Colour = (0, 140, 100)
HYPOTHESIS: Colour = (240, 110, 180)
HINDSIGHT: Colour = (86, 180, 233)
WHEELS: Colour = (185, 105, 0)  # what either says of the way; far apart for every kind of colour vision
LASER: Colour = (20, 90, 230)
WALLS: Colour = (70, 70, 70)
NEUTRAL: Colour = (130, 130, 130)
LETTERING: Colour = (0, 0, 0)  # on the grey that either theme of the viewer puts behind it
FLOOR: Colour = (250, 250, 250)  # behind what has no map
UNKNOWN: Colour = (205, 205, 205)  # as map_server draws it; the background too

# Runs side by side: Okabe and Ito's, which every kind of colour vision tells apart.
RUNS: tuple[Colour, ...] = ((0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (86, 180, 233), (230, 159, 0))

# Weight relative to the mean weight, log10: the ends of the colour scale, and of the histogram's axis.
COLOUR_RANGE = (-2.0, 2.0)
HISTOGRAM_RANGE = (-6.0, 5.0)
HISTOGRAM_BINS = 55
MOST_APART = 5.0
"""Times the limit of chance at which the curve of how far wheels and laser are apart ends."""

# viridis at 16 equal steps, light to dark: the heavier a particle, the darker on the map's white floor.
WEIGHT_COLOURS: NDArray[np.uint8] = np.array(
    [
        (253, 231, 37), (210, 226, 27), (165, 219, 54), (122, 209, 81), (84, 197, 104), (53, 183, 121),
        (34, 168, 132), (31, 152, 139), (35, 136, 142), (42, 120, 142), (49, 104, 142), (57, 86, 140),
        (65, 68, 135), (70, 50, 126), (72, 27, 109), (68, 1, 84),
    ],
    dtype=np.uint8,
)  # fmt: skip


VERDICTS: dict[str, Colour] = {
    "found": (0, 158, 115),
    "ambiguous": (240, 200, 60),
    "off the map": (86, 180, 233),
    "lost": (213, 94, 0),
}

CHANGED_COLOURS: NDArray[np.uint8] = np.array(
    [(0, 0, 0), (213, 94, 0), (86, 180, 233), (190, 235, 190)], dtype=np.uint8
)
"""Of cells that are as mapped (not drawn), of a wall that the map lacks, of one that is gone, of floor it lacks."""

HEAT_RANGE = 5.0
"""Nats behind the best cell at which the colours of a search end."""


def heat_levels(heat: NDArray[np.float32]) -> NDArray[np.int64]:
    """Index into WEIGHT_COLOURS for nats behind the best cell (m,), 0 or less: the best is the darkest."""
    scaled = (1.0 + np.clip(heat, -HEAT_RANGE, 0.0) / HEAT_RANGE) * len(WEIGHT_COLOURS)
    return np.minimum(scaled.astype(np.int64), len(WEIGHT_COLOURS) - 1)


def weight_levels(log_weights: NDArray[np.float64], chosen: NDArray[np.int64]) -> NDArray[np.int64]:
    """Index into WEIGHT_COLOURS of the chosen particles, with the mean weight 1 / n in the middle of the scale.

    ``log_weights``: (n,), natural, normalised; ``chosen``: (m,) indices; returns (m,).
    """
    low, high = COLOUR_RANGE
    relative = relative_weights(log_weights[chosen], len(log_weights))
    scaled = (np.clip(relative, low, high) - low) * (len(WEIGHT_COLOURS) / (high - low))
    return np.minimum(scaled.astype(np.int64), len(WEIGHT_COLOURS) - 1)


def relative_weights(log_weights: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """log10(w * n): 0 is the mean weight of n = ``count`` particles, 1 ten times that. ``log_weights``: natural."""
    return (log_weights + np.log(max(count, 1))) * np.log10(np.e)
