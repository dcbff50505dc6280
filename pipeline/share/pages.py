"""Writes pages with runs: one by itself, or a folder of them with an index."""

from __future__ import annotations

import base64
import gzip
import html
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from pipeline.compare import Compared
from pipeline.errors import MclError
from pipeline.export.run import Run, read_run
from pipeline.outputs import check_folder, check_output, replacing
from pipeline.share import player
from pipeline.share.index import index

INDEX = "index.html"
SUFFIXES = (".html", ".htm")
"""How the name of a page ends."""
_GZIP_LEVEL = 6  # of the viewer's 43 MB: level 9 takes twice as long for a hundredth less


@dataclass(frozen=True)
class Viewer:
    """Rerun's viewer for browsers, ready to be put into a page: its script, and its WebAssembly packed as text."""

    javascript: str
    wasm: str


def rerun_viewer() -> Viewer:
    """The one that is installed. Raises MclError without one."""
    from pipeline.recording.viewer import web_files

    javascript, wasm = web_files()
    return Viewer(javascript.replace("</script", "<\\/script"), _packed(wasm))


def share(path: Path, output: Path, *, viewer: Viewer | None = None, force: bool = False) -> Run:
    """Write one page with the run at ``path``: with our own player, or with rerun's ``viewer`` if one is given.

    Raises MclError if there is no run, or if ``output`` exists already and ``force`` does not say to replace it.
    """
    check(output, force)
    run = read_run(path)
    _write(output, _page(run, viewer))
    return run


def share_comparison(compared: Sequence[Compared], output: Path, *, force: bool = False) -> None:
    """Write one page with runs, and tracks of other filters, side by side on one clock; the first of them is a run.

    Raises MclError if ``output`` exists already and ``force`` does not say to replace it.
    """
    check(output, force)
    _write(output, player.page(compared))


def check(output: Path, force: bool) -> None:
    """Raises MclError for what would be known only after a while."""
    if output.suffix.lower() not in SUFFIXES:
        raise MclError("a page's name ends in .html", path=output)
    check_output(output, force)


def share_folder(
    paths: Sequence[Path], folder: Path, *, viewer: Viewer | None = None, force: bool = False
) -> list[Path]:
    """Write a page for each run into ``folder``, and an index of them with summaries and pictures, named last.

    Raises MclError for what is no run, and for files of these names unless ``force`` says to replace them;
    other files in the folder are left alone.
    """
    runs = [read_run(path) for path in paths]
    names = _names(runs)
    check_folder(folder, (*names, INDEX), force)
    folder.mkdir(parents=True, exist_ok=True)
    for run, name in zip(runs, names, strict=True):
        _write(folder / name, _page(run, viewer))
    _write(folder / INDEX, index(runs, names))
    return [folder / name for name in (*names, INDEX)]


def _page(run: Run, viewer: Viewer | None) -> str:
    if viewer is None:
        return player.page([run])
    page = resources.files("pipeline.share").joinpath("rerun.html").read_text(encoding="utf-8")
    parts = {
        "@TITLE@": html.escape(f"{run.name}, seed {run.seed}"),
        "@WASM@": viewer.wasm,
        "@RECORDING@": _packed(run.told.path.read_bytes()),
        "@JAVASCRIPT@": viewer.javascript,
    }
    # All at once: what is put in may itself look like one of the marks.
    return re.sub("|".join(parts), lambda mark: parts[mark[0]], page)


def _names(runs: Sequence[Run]) -> list[str]:
    """Names of files: the log and the seed, numbered where runs share them."""
    names: list[str] = []
    for run in runs:
        stem = re.sub(r"[^\w.+-]+", "_", f"{run.name}-seed{run.seed}").strip(".") or "run"
        number = 1
        while (name := f"{stem}.html" if number == 1 else f"{stem}-{number}.html") in (*names, INDEX):
            number += 1
        names.append(name)
    return names


def _packed(data: bytes) -> str:
    return base64.b64encode(gzip.compress(data, _GZIP_LEVEL, mtime=0)).decode("ascii")


def _write(path: Path, page: str) -> None:
    with replacing(path) as partial:
        partial.write_text(page, encoding="utf-8")
