"""A whole run as a movie: GIF and WebP through Pillow, MP4 and WebM through PyAV where that is installed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import gaussian_filter1d

from pipeline.errors import MclError
from pipeline.export.canvas import Raster
from pipeline.export.legend import entries
from pipeline.export.pictures import Painter, full
from pipeline.export.run import Run, key_moments
from pipeline.export.theme import Theme

CAMERAS = ("whole", "follow")
"""Which of the two views of the map is the large one: all of it, or what is near the robot."""
HOLD = 1.0
"""Seconds that the last picture stays."""
PALETTE_FROM = 8
"""Pictures whose colours make the palette of a GIF."""
COLOURS = 127
"""Of a GIF, beside the one that is transparent."""
WEBP_QUALITY = 70
H264 = {"crf": "22", "preset": "veryfast"}
VP9 = {"crf": "36", "b": "0", "deadline": "good", "cpu-used": "5", "row-mt": "1"}

SLOWEST, FASTEST = 2, 64
"""How much quicker than it was an automatic speed shows what happens, and what does not matter, at most."""
QUIET_FOR = 20.0
"""Seconds of the movie that an automatic speed has for a run in which nothing happens."""
NEAR = 1.5
"""Seconds of the movie before and after an event that are slow, and again as much for every doubling from there."""
SMOOTH = 0.6
"""Seconds of the run over which a camera that follows evens out where it looks: an estimate trembles."""


class Progress(Protocol):
    """Passes the pictures on and shows how many of ``total`` have passed: ``console.progress``."""

    def __call__(self, items: Iterable[Any], total: int, label: str) -> Iterator[Any]:
        """Iterate lazily over the pictures."""
        ...


@dataclass(frozen=True)
class Film:
    """``width`` and ``height`` in pixels; ``speed``: how much quicker than it was, or "auto"; ``fps``: pictures per
    second; ``camera``: one of CAMERAS."""

    width: int
    height: int
    speed: float | Literal["auto"]
    fps: int
    camera: str
    theme: Theme


def movie(run: Run, path: Path, film: Film, progress: Progress | None = None) -> None:
    """Write the run in the format of the suffix."""
    write = _WRITERS[path.suffix.lower()]
    width, height = (k - k % 2 for k in (film.width, film.height))  # H.264 halves the resolution of colours
    painter = Painter(run, full(width, height), film.theme, _looks_at(run) if film.camera == "follow" else None)
    shots = _shots(run, film)
    shown = iter(shots) if progress is None else progress(shots, len(shots), "drawing")
    write(path, _frames(painter, shown), painter, film.fps)


def pace(run: Run, time: float) -> int:
    """How much quicker than it was an automatic speed shows what is at ``time``, s: a power of two.

    SLOWEST where something happens to the belief, twice as quick with every NEAR seconds of the movie from there on, up
    to what shows a run in which nothing happens in QUIET_FOR seconds.
    """
    highest = SLOWEST
    while highest < FASTEST and run.told.duration / highest > QUIET_FOR:
        highest *= 2
    away = min(abs(float(run.scenes.times[at.row]) - time) for at in key_moments(run)[:-1])
    factor = SLOWEST
    while factor < highest and away > NEAR * factor:
        away -= NEAR * factor
        factor *= 2
    return factor


def _shots(run: Run, film: Film) -> list[tuple[int, float]]:
    """Of every picture the row of the run that it shows, and how much quicker than it was the run passes there."""
    times = run.scenes.times
    now, end, shots = float(times[0]), float(times[-1]), list[tuple[int, float]]()
    if film.speed == "auto":
        while now < end:
            factor = pace(run, now)
            shots.append((run.scenes.row_at(now), factor))
            now += factor / film.fps
        shots.append((len(times) - 1, shots[-1][1] if shots else SLOWEST))
    else:
        count = int(np.ceil((end - now) / film.speed * film.fps)) + 1
        at = now + np.arange(count) * (film.speed / film.fps)
        shots = [(run.scenes.row_at(float(t)), film.speed) for t in at]
    return [*shots, *[(len(times) - 1, shots[-1][1])] * round(HOLD * film.fps)]


def _looks_at(run: Run) -> NDArray[np.float64]:
    """(n, 2) where a camera that follows the estimate looks, m in the map frame."""
    scenes = run.scenes
    interval = float(np.median(np.diff(scenes.times))) if len(scenes) > 1 else 1.0
    return gaussian_filter1d(scenes.estimates[:, :2], SMOOTH / max(interval, 1e-3), axis=0, mode="nearest")


def _frames(painter: Painter, shots: Iterable[tuple[int, float]]) -> Iterator[Raster]:
    before, frame = (-1, 0.0), np.empty(0, np.uint8)
    for row, factor in shots:
        if (row, factor) != before:
            frame, before = painter.draw(row, sentence=painter.run.sentence(row), factor=factor), (row, factor)
        yield frame


def _gif(path: Path, frames: Iterator[Raster], painter: Painter, fps: int) -> None:
    palette = _palette(painter)
    pictures = _changes(frames, palette)
    # A GIF counts in hundredths of a second.
    next(pictures).save(
        path, "GIF", save_all=True, append_images=pictures, duration=round(100 / fps) * 10, loop=0, optimize=False,
        transparency=COLOURS, disposal=1,
    )  # fmt: skip


def _palette(painter: Painter) -> Image.Image:
    """One palette for all frames, so that nothing flickers: what the legend names exactly, and what else there is."""
    named = [colour for _, colours in entries(painter.run.scenes, painter.theme) for colour in colours]
    rows = np.linspace(0, len(painter.run.scenes) - 1, PALETTE_FROM).astype(int)
    samples = np.concatenate([painter.draw(int(row))[::2, ::2] for row in rows])
    others = Image.fromarray(samples).quantize(COLOURS - len(named), Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    palette = Image.new("P", (1, 1))
    palette.putpalette([part for colour in named for part in colour] + (others.getpalette() or []))
    return palette


def _changes(frames: Iterable[Raster], palette: Image.Image) -> Iterator[Image.Image]:
    """The frames in the palette's colours; what is as in the one before is transparent, which takes a third."""
    colours = [*(palette.getpalette() or []), *[0] * 768][: 3 * (COLOURS + 1)]
    before: NDArray[np.uint8] | None = None
    for frame in frames:
        shown = np.asarray(Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE))
        changed = shown if before is None else np.where(shown == before, np.uint8(COLOURS), shown)
        picture, before = Image.fromarray(changed), shown
        picture.putpalette(colours)
        yield picture


def _webp(path: Path, frames: Iterator[Raster], _: Painter, fps: int) -> None:
    pictures = (Image.fromarray(frame) for frame in frames)
    next(pictures).save(
        path, "WEBP", save_all=True, append_images=pictures, duration=round(1000 / fps), loop=0,
        quality=WEBP_QUALITY, method=0,
    )  # fmt: skip


def _mp4(path: Path, frames: Iterator[Raster], painter: Painter, fps: int) -> None:
    _video(path, frames, painter, fps, "h264", H264, {"movflags": "+faststart", "fflags": "+bitexact"})


def _webm(path: Path, frames: Iterator[Raster], painter: Painter, fps: int) -> None:
    _video(path, frames, painter, fps, "libvpx-vp9", VP9, {"fflags": "+bitexact"})  # else an id of chance is in it


def _video(
    path: Path, frames: Iterator[Raster], painter: Painter, fps: int,
    codec: str, quality: dict[str, str], container: dict[str, str],
) -> None:  # fmt: skip
    av = _pyav(path)
    with av.open(str(path), "w", format=path.suffix[1:].lower(), options=container) as file:
        stream = file.add_stream(codec, rate=fps, options=quality)
        stream.width, stream.height, stream.pix_fmt = painter.layout.width, painter.layout.height, "yuv420p"
        for frame in frames:
            file.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        file.mux(stream.encode(None))


def check_writable(path: Path) -> None:
    """Raises MclError if this kind of movie cannot be written here."""
    if path.suffix.lower() in (".mp4", ".webm"):
        _pyav(path)


def _pyav(path: Path) -> Any:
    try:
        import av
    except ImportError:
        raise MclError(
            f"{path.suffix[1:].upper()} needs PyAV, which is not installed",
            "pip install 'mcl-replay[video]', or name a .gif or .webp",
            path=path,
        ) from None
    return av


_WRITERS = {".gif": _gif, ".webp": _webp, ".mp4": _mp4, ".webm": _webm}
MOVIES = tuple(_WRITERS)
"""Suffixes of movies."""
