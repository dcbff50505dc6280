"""The beam model in its parts, beside the histogram of what this log measured where the map ends the beams as far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.filter.beam_model import BeamDensity, Mixture, mixture_density
from pipeline.filter.step import Step
from pipeline.judgement.verdict import TRUSTED
from pipeline.recording import entities, palette

Array = NDArray[np.float64]

BINS = 40
"""Up to twice the true range; one more takes the readings without return, beside a gap of one."""
FINE = 16  # places in a bin at which the density is asked for
AROUND = 0.2  # of the true range: beams whose own is so near are counted, moved by the difference
ONE_IN = 4  # scans that are counted: neighbours measure the same
PARTS = ("1_hit", "2_short", "3_too_long", "4_random")
"""Below ``entities.PARTS``, in the order in which they are painted: each has those behind it in its height."""
NO_RETURN = "5_no_return"
WORDS = ("hit", "short", "too long", "random", "no return (max)")
COLOURS = (palette.HIT, palette.SHORT, palette.LONG, palette.CURVE, palette.NO_RETURN)


@dataclass(frozen=True)
class Shares:
    """Per cent of the readings, by the model and as measured, None where nothing was; in the order of WORDS."""

    model: NDArray[np.float64]
    measured: NDArray[np.float64] | None


class SensorParts:
    """Counts what was measured while the robot was known to be where it was, and says what the model expects.

    ``wall`` is the true range that is shown, m.
    """

    def __init__(self, config: Config, density: BeamDensity, max_range: float) -> None:
        self._config, self._density, self._max_range = config, density, max_range
        self.wall = min(5.0, max_range / 2)
        self.width = 2 * self.wall / BINS
        self._counts = np.zeros(BINS + 1, np.int64)  # the last: without return
        self._kinds = np.zeros(len(WORDS), np.int64)

    def hear(self, steps: Sequence[Step]) -> None:
        """Counts the beams of some of these scans."""
        known = [s.beams for s in steps if s.index % ONE_IN == 0 and s.verdict.kind in TRUSTED]
        if not known:
            return
        z, star = (np.concatenate([getattr(b, name) for b in known]) for name in ("measured", "expected"))
        near = (np.abs(star - self.wall) <= AROUND * self.wall) & ~np.isnan(z)
        z, star = z[near].astype(np.float64), star[near].astype(np.float64)
        lost = np.isposinf(z)
        z, star = z[~lost], star[~lost]
        self._counts[-1] += int(lost.sum())
        moved = np.floor((z - star + self.wall) / self.width).astype(np.int64)
        self._counts[:-1] += np.bincount(moved[(moved >= 0) & (moved < BINS)], minlength=BINS)
        hit = self._density.is_hit(z, star)
        short = ~hit & (z < star)
        self._kinds += [hit.sum(), short.sum(), (~hit & ~short).sum(), 0, lost.sum()]

    @property
    def seen(self) -> int:
        """Beams that were counted."""
        return int(self._kinds.sum())

    def shares(self) -> Shares:
        """What the parts have of all readings. Those that are no hits are short or too long, random ones with them."""
        c = self._config
        model = np.array([c.z_hit, c.z_short, c.z_long, c.z_rand, c.z_max])
        return Shares(100 * model / model.sum(), 100 * self._kinds / self.seen if self.seen else None)

    def model(self) -> dict[str, rr.BarChart]:
        """The charts of the model, by their name below ``entities.PARTS``; of one that is not a mixture, its sum."""
        edges = (np.arange(BINS * FINE) + 0.5) * self.width / FINE
        if isinstance(self._density, Mixture):
            names = ("z_hit", "z_short", "z_long", "z_rand")
            heights = []
            for k in range(len(names)):
                parts = self._config.model_copy(update=dict.fromkeys(names[:k], 0.0))
                heights.append(mixture_density(edges, np.full_like(edges, self.wall), parts, self._max_range))
        else:
            heights = [self._density.density(edges, np.full_like(edges, self.wall))]
        charts = {
            name: self._chart(np.append(100 * self.width * h.reshape(BINS, FINE).mean(axis=1), 0.0), colour, -1.0)
            for name, h, colour in zip(PARTS, heights, COLOURS, strict=False)
        }
        lost = np.zeros(BINS + 1)
        lost[-1] = 100 * float(self._density.no_return(np.array([self.wall]))[0])
        return charts | {NO_RETURN: self._chart(lost, palette.NO_RETURN, -1.0)}

    def measured(self) -> rr.BarChart:
        """The histogram of what was measured."""
        return self._chart(100.0 * self._counts / max(self.seen, 1), palette.ESTIMATE, 1.0)

    def _chart(self, heights: Array, colour: palette.Colour, side: float) -> rr.BarChart:
        # Model and log stand side by side in each bin: side = -1 and 1.
        at = self.width * (np.append(np.arange(BINS), BINS + 1) + 0.5 + side / 4)
        widths = np.full(BINS + 1, self.width / 2, np.float32)
        return rr.BarChart(
            heights.astype(np.float32), abscissa=at.astype(np.float32), widths=widths, color=(*colour, 255)
        )


def logged(parts: SensorParts) -> list[tuple[str, Any]]:
    """Entities and charts of the model."""
    return [(f"{entities.PARTS}/{name}", chart) for name, chart in parts.model().items()]
