"""The index of a folder of pages: a table of the runs that sorts, with pictures, and flags at those that are lost."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image

from pipeline.compare import Figures, figures
from pipeline.evaluate.metrics import END
from pipeline.export.pictures import thumbnail
from pipeline.export.run import Run, differing
from pipeline.judgement.verdict import KINDS
from pipeline.share.template import filled

THUMBNAIL = (320, 200)
NAMED = 4
"""Parameters that have a column if the runs differ in them."""


@dataclass(frozen=True)
class Cell:
    """What stands in the table: markup, and what it is sorted by."""

    markup: str
    order: float | str


def index(runs: Sequence[Run], names: Sequence[str]) -> str:
    """The page, HTML; ``names`` of the runs' pages, beside it."""
    told = [figures(run) for run in runs]
    columns = {"at the end": [_state(run, f) for run, f in zip(runs, told, strict=True)]}
    columns |= {"found": [_number(_share_found(run), _percent) for run in runs]}
    columns |= {words: [_number(value(f), show) for f in told] for words, value, show in _NUMBERS}
    columns |= {name: [_parameter(value) for value in values] for name, values in list(differing(runs).items())[:NAMED]}
    columns = {words: cells for words, cells in columns.items() if any(cell.markup != "-" for cell in cells)}
    heads = "".join(
        f'<th scope="col"><button type="button">{html.escape(word)}</button></th>' for word in ("run", *columns)
    )
    rows = [
        _row(run, name, bool(_flags(run, told[k])), [cells[k] for cells in columns.values()])
        for k, (run, name) in enumerate(zip(runs, names, strict=True))
    ]
    flagged = sum(bool(_flags(run, f)) for run, f in zip(runs, told, strict=True))
    count = f"{len(runs)} {'run' if len(runs) == 1 else 'runs'}, {flagged or 'none'} flagged"
    parts = {"COUNT": count, "HEADS": heads, "ROWS": "\n".join(rows)}
    return filled("index.html", title="Runs", styles=["index.css"], scripts=["index.js"], parts=parts)


def _row(run: Run, name: str, flagged: bool, cells: Sequence[Cell]) -> str:
    title, link = html.escape(f"{run.name}, seed {run.seed}"), html.escape(name)
    picture = f'<img src="{_picture(run)}" width="{THUMBNAIL[0]}" height="{THUMBNAIL[1]}" alt="">'
    told = "".join(f'<td data-order="{html.escape(str(cell.order))}">{cell.markup}</td>' for cell in cells)
    first = f'<th scope="row" data-order="{title}"><a href="{link}">{picture}{title}</a></th>'
    return f"<tr class={'flagged' if flagged else 'sound'}>{first}{told}</tr>"


def _flags(run: Run, told: Figures) -> list[str]:
    """Why somebody should look at this run; nothing if the robot is found at its end."""
    found = [f"{_end(run)} at the end"] if len(run.told.verdicts) and _end(run) in ("lost", "ambiguous") else []
    if told.end_error is not None and told.end_error > END[0]:
        found.append(f"{told.end_error:.1f} m from the truth at the end")
    if told.converged_at is None:
        found.append("never converged")
    return found


def _end(run: Run) -> str:
    return KINDS[run.told.verdicts[-1]]


def _state(run: Run, told: Figures) -> Cell:
    kind = _end(run) if len(run.told.verdicts) else ""
    chip = f'<span class="verdict {kind.split(" ")[0]}">{kind}</span>' if kind else ""
    flags = "".join(f'<span class="flag">⚑ {html.escape(flag)}</span>' for flag in _flags(run, told))
    return Cell(chip + flags or "-", (-KINDS.index(kind) if kind else 0) - 10.0 * bool(flags))


def _share_found(run: Run) -> float | None:
    found = np.isin(run.told.verdicts, [KINDS.index("found"), KINDS.index("off the map")])
    return float(found.mean()) if len(found) else None


def _number(value: float | None, show: Callable[[float], str]) -> Cell:
    return Cell("-", np.inf) if value is None else Cell(show(value), value)


def _parameter(value: object) -> Cell:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return Cell(f"{value:g}", value)
    return Cell(html.escape(str(value)), str(value))


def _percent(value: float) -> str:
    return f"{100 * value:.0f} %"


def _metres(value: float) -> str:
    return f"{value:.2f} m"


def _seconds(value: float) -> str:
    return f"{value:.1f} s" if np.isfinite(value) else "never"


def _count(value: float) -> str:
    return f"{value:,.0f}"


_NUMBERS: tuple[tuple[str, Callable[[Figures], float | None], Callable[[float], str]], ...] = (
    ("converged", lambda f: np.inf if f.converged_at is None else f.converged_at, _seconds),
    ("times lost", lambda f: f.lost, _count),
    ("explained", lambda f: f.explained, _percent),
    ("error", lambda f: f.error, _metres),
    ("error at the end", lambda f: f.end_error, _metres),
    ("scans", lambda f: f.scans, _count),
    ("duration", lambda f: f.duration, _seconds),
    ("particles", lambda f: f.particles, _count),
    ("wall", lambda f: f.wall, _seconds),
)
"""Columns: what is above them, a figure, and how it is written."""


def _picture(run: Run) -> str:
    packed = io.BytesIO()
    Image.fromarray(thumbnail(run, len(run.scenes) - 1, *THUMBNAIL)).save(packed, "WEBP", quality=80)
    return f"data:image/webp;base64,{base64.b64encode(packed.getvalue()).decode('ascii')}"
