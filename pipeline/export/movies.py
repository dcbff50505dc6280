"""A whole run as a movie: GIF and WebP through Pillow, MP4 through PyAV where that is installed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from PIL import Image

from pipeline.errors import MclError
from pipeline.export.canvas import Raster
from pipeline.export.pictures import Painter, full
from pipeline.export.run import Run

HOLD = 1.0
"""Seconds that the last picture stays."""
PALETTE_FROM = 8
"""Pictures whose colours make the palette of a GIF."""
WEBP_QUALITY = 70
H264 = {"crf": "22", "preset": "veryfast"}


class Progress(Protocol):
    """Passes the pictures on and shows how many of ``total`` have passed: ``console.progress``."""

    def __call__(self, items: Iterable[int], total: int, label: str) -> Iterator[int]:
        """Iterate lazily over the rows."""
        ...


def movie(run: Run, path: Path, size: tuple[int, int], speed: float, fps: int, progress: Progress | None) -> None:
    """Write the run, ``speed`` times as quick as it was, ``fps`` pictures a second, in the format of the suffix."""
    write = _WRITERS[path.suffix.lower()]
    width, height = (k - k % 2 for k in size)  # H.264 halves the resolution of colours
    painter = Painter(run, full(width, height))
    rows = _rows(run, speed, fps)
    shown = iter(rows) if progress is None else progress(rows, len(rows), "drawing")
    write(path, _frames(painter, shown), painter, fps)


def _rows(run: Run, speed: float, fps: int) -> list[int]:
    """Which row of the run every picture shows."""
    times = run.scenes.times
    seconds = float(times[-1] - times[0]) / speed
    at = times[0] + np.arange(int(np.ceil(seconds * fps)) + 1) * (speed / fps)
    return [*(run.scenes.row_at(float(t)) for t in at), *[len(times) - 1] * round(HOLD * fps)]


def _frames(painter: Painter, rows: Iterable[int]) -> Iterator[Raster]:
    before, frame = -1, np.empty(0, np.uint8)
    for row in rows:
        if row != before:
            frame, before = painter.draw(row, sentence=painter.run.sentence(row)), row
        yield frame


def _gif(path: Path, frames: Iterator[Raster], painter: Painter, fps: int) -> None:
    # One palette for all: the colours that the picture has anywhere, so that nothing flickers.
    rows = np.linspace(0, len(painter.run.scenes) - 1, PALETTE_FROM).astype(int)
    samples = np.concatenate([painter.draw(int(row))[::2, ::2] for row in rows])
    palette = Image.fromarray(samples).quantize(255, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    indexed = (Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    # A GIF counts in hundredths of a second.
    next(indexed).save(
        path, "GIF", save_all=True, append_images=indexed, duration=round(100 / fps) * 10, loop=0, optimize=False
    )


def _webp(path: Path, frames: Iterator[Raster], _: Painter, fps: int) -> None:
    pictures = (Image.fromarray(frame) for frame in frames)
    next(pictures).save(
        path, "WEBP", save_all=True, append_images=pictures, duration=round(1000 / fps), loop=0,
        quality=WEBP_QUALITY, method=0,
    )  # fmt: skip


def _mp4(path: Path, frames: Iterator[Raster], painter: Painter, fps: int) -> None:
    av = _pyav(path)
    with av.open(str(path), "w", format="mp4", options={"movflags": "+faststart"}) as file:
        stream = file.add_stream("h264", rate=fps, options=H264)
        stream.width, stream.height, stream.pix_fmt = painter.layout.width, painter.layout.height, "yuv420p"
        for frame in frames:
            file.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        file.mux(stream.encode(None))


def check_writable(path: Path) -> None:
    """Raises MclError if this kind of movie cannot be written here."""
    if path.suffix.lower() == ".mp4":
        _pyav(path)


def _pyav(path: Path) -> Any:
    try:
        import av
    except ImportError:
        raise MclError(
            "MP4 needs PyAV, which is not installed",
            "pip install 'mcl-replay[video]', or name a .gif or .webp",
            path=path,
        ) from None
    return av


_WRITERS = {".gif": _gif, ".webp": _webp, ".mp4": _mp4}
MOVIES = tuple(_WRITERS)
"""Suffixes of movies."""
