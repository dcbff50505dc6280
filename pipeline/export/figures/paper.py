"""The sheet that a figure is drawn on: its width, its type, its colours, and how it becomes a file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.export.sizes import MM_PER_INCH, Size
from pipeline.export.theme import Theme
from pipeline.recording.palette import Colour

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VECTORS = (".pdf", ".svg")
"""Suffixes of what stays sharp at any size."""
WIDE = 120.0 / MM_PER_INCH
"""Inches from which on panels stand side by side."""


@dataclass(frozen=True)
class Paper:
    """``size`` and ``theme`` of a figure; ``dpi``: pixels an inch of what is pixels, images too unless ``exact``.

    Images are kept as they are in a PDF; an SVG that does so is shown without smoothing, and thin walls get lost.
    """

    size: Size
    theme: Theme
    dpi: int
    exact: bool

    @property
    def width(self) -> float:
        """Inches."""
        return self.size.inches(self.dpi)[0]

    @property
    def wide(self) -> bool:
        """Whether panels have room side by side."""
        return self.width >= WIDE

    def figure(self, height: float) -> Figure:
        """An empty one, ``height`` inches high unless the size says otherwise; within ``styled`` only."""
        from matplotlib.figure import Figure

        asked = self.size.inches(self.dpi)[1]
        return Figure(figsize=(self.width, asked or height), dpi=self.dpi, layout="constrained")

    @contextmanager
    def styled(self) -> Iterator[None]:
        """Type that can be read in a column, thin lines, and the theme, whatever matplotlib's settings are."""
        from matplotlib import style

        ground, ink, pale = (rgb(c) for c in (self.theme.ground, self.theme.ink, self.theme.pale))
        settings: dict[str, Any] = {
            "font.family": "DejaVu Sans", "font.size": 7.0, "axes.labelsize": 7.5, "axes.titlesize": 7.5,
            "xtick.labelsize": 7.0, "ytick.labelsize": 7.0, "legend.fontsize": 7.0, "legend.frameon": False,
            "legend.handlelength": 2.6, "legend.columnspacing": 1.4, "figure.facecolor": ground,
            "axes.facecolor": ground, "savefig.facecolor": ground, "text.color": ink, "axes.labelcolor": ink,
            "axes.edgecolor": ink, "xtick.color": ink, "ytick.color": ink, "grid.color": pale, "grid.linewidth": 0.4,
            "axes.linewidth": 0.6, "xtick.major.width": 0.6, "ytick.major.width": 0.6, "xtick.minor.width": 0.4,
            "ytick.minor.width": 0.4, "xtick.major.size": 2.5, "ytick.major.size": 2.5, "xtick.minor.size": 1.5,
            "ytick.minor.size": 1.5, "lines.linewidth": 1.0, "axes.axisbelow": True, "axes.titlepad": 8.0,
            "figure.constrained_layout.w_pad": 0.03, "figure.constrained_layout.h_pad": 0.04,
            # Text stays text in a PDF, its font inside; in an SVG it is drawn, for few programs read fonts in there.
            "pdf.fonttype": 42, "svg.fonttype": "path", "svg.hashsalt": "mcl",
        }  # fmt: skip
        with style.context(["default", settings]):
            yield

    def legend(self, figure: Figure) -> None:
        """Below all panels, where it lies on no data, in as many columns as there is room for."""
        found = _entries(figure)
        handles, words = list(found.values()), list(found)
        for columns in range(len(words), 0, -1):
            drawn = figure.legend(handles, words, loc="outside lower center", ncols=columns, borderaxespad=0.3)
            if drawn.get_window_extent().width <= 0.98 * figure.bbox.width:
                return
            drawn.remove()

    def save(self, figure: Figure, path: Path, title: str) -> None:
        """In the format of the suffix, with no date in it: the same figure is the same bytes."""
        kind = path.suffix.lower()
        told: dict[str, Any] = {"Title": title}
        if kind == ".pdf":
            told |= {"CreationDate": None, "Creator": "mcl-replay"}
        elif kind == ".svg":
            told |= {"Date": None, "Creator": "mcl-replay"}
        figure.savefig(path, dpi=self.dpi, metadata=None if kind == ".jpg" else told)


def _entries(figure: Figure) -> dict[str, Any]:
    """What is drawn, by what it is called: each once, in whichever panel it is."""
    found: dict[str, Any] = {}
    for axes in figure.axes:
        handles, words = axes.get_legend_handles_labels()
        found |= dict(zip(words, handles, strict=True))
    return found


def rgb(colour: Colour) -> tuple[float, float, float]:
    """As matplotlib has it."""
    red, green, blue = colour
    return (red / 255, green / 255, blue / 255)
