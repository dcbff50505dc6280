"""A page of one look at a log: findings, a timeline of messages and silences, topics. One file, nothing is loaded."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Sequence
from importlib import resources
from pathlib import Path

import numpy as np

from pipeline.check.findings import GRADES, Finding
from pipeline.check.looking import Report
from pipeline.check.recording import SeenTopic
from pipeline.motion.gaps import LONG, TIMES
from pipeline.outputs import replacing
from pipeline.printable import printable

WIDTH, LEFT, LANE, HEIGHT = 1000, 190, 34, 22
"""Of the timeline, in its own units: all of it, the names, from lane to lane, a lane's bars."""
BINS = 200
LANES = 24
"""Topics that are drawn, those with the most messages."""
COLOURS = {"broken": "#b3261e", "doubtful": "#c98a1b", "noted": "#7b8794"}
TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600, 7200, 21600, 86400)
"""s from tick to tick."""


def write_page(report: Report, path: Path) -> None:
    """Write the page; MclError if that cannot be done."""
    with replacing(path) as partial:
        partial.write_text(page(report), encoding="utf-8")


def page(report: Report) -> str:
    """The page as HTML, with everything that came from the log escaped."""
    template = resources.files("pipeline.check").joinpath("page.html").read_text(encoding="utf-8")
    parts = {
        "@TITLE@": _text(report.path.name),
        "@VERDICT@": _text(verdict(report.findings)),
        "@FINDINGS@": _findings(report.findings),
        "@TIMELINE@": timeline(report),
        "@FACTS@": _table((), report.facts),
        "@TOPICS@": _table(("topic", "type", "messages", "per second", "longest gap"), map(row, report.topics)),
    }
    # All at once: what is put in may itself look like one of the marks.
    return re.sub("|".join(parts), lambda mark: parts[mark[0]], template)


def verdict(findings: Sequence[Finding]) -> str:
    """How many findings of each grade there are, in one line."""
    counts = [(sum(finding.grade == grade for finding in findings), grade) for grade in GRADES]
    said = ", ".join(f"{count} {grade}" for count, grade in counts if count)
    return said or "nothing was found"


def row(topic: SeenTopic) -> tuple[str, ...]:
    """A topic as texts: name, type, messages, rate, longest gap."""
    rate, gap = topic.rate, topic.longest_gap
    return (
        topic.name,
        topic.type or "unknown",
        f"{topic.count:,}",
        "" if rate is None else f"{rate:.1f}",
        "" if gap is None else f"{gap:.2f} s",
    )


def timeline(report: Report) -> str:
    """An SVG: a lane for each topic whose messages were read, and marks for the findings that have a time."""
    lanes = sorted((t for t in report.topics if t.times is not None and len(t.times)), key=lambda t: -t.count)[:LANES]
    if not lanes:
        return "<p>No topic of it could be read.</p>"
    ends = [float(t.times[-1]) for t in lanes if t.times is not None]
    first = min(float(t.times[0]) for t in lanes if t.times is not None)
    span = max(max(ends) - first, 1e-3)
    marks = [(f, f.span) for f in report.findings if f.span is not None]
    height = LANE * (len(lanes) + bool(marks)) + 24
    parts = [f'<svg viewBox="0 0 {WIDTH} {height}" role="img" aria-label="messages over time">']
    for number, topic in enumerate(lanes):
        parts += _lane(topic, number * LANE, first, span)
    top = len(lanes) * LANE
    for finding, (begin, end) in marks:
        x0, x1 = (_x(report.scans_begin + t, first, span) for t in (begin, end))
        parts.append(
            f'<rect x="{x0:.1f}" y="{top + 6}" width="{max(x1 - x0, 3):.1f}" height="14" '
            f'fill="{COLOURS[finding.grade]}" fill-opacity="0.7"><title>{_text(finding.text)}</title></rect>'
        )
    if marks:
        parts.append(f'<text x="0" y="{top + 18}">findings</text>')
    parts += _axis(height, first, span, report.scans_begin)
    return "\n".join([*parts, "</svg>"])


def _lane(topic: SeenTopic, y: int, first: float, span: float) -> list[str]:
    assert topic.times is not None
    bins = max(1, min(BINS, len(topic.times) // 4))  # with fewer in each, a steady topic would look like a comb
    counts, edges = np.histogram(topic.times, bins=bins, range=(first, first + span))
    most = max(int(counts.max()), 1)
    parts = [f'<text x="0" y="{y + 16}">{_text(_shortened(topic.name))}<title>{_text(topic.name)}</title></text>']
    tops = [(edge, y + HEIGHT - HEIGHT * counts[k] / most) for k in range(bins) for edge in edges[k : k + 2]]
    points = " ".join(f"{_x(float(edge), first, span):.1f},{top:.1f}" for edge, top in tops)
    ends = f"{LEFT},{y + HEIGHT} {points} {WIDTH},{y + HEIGHT}"
    parts.append(f'<polygon points="{ends}" fill="#34526f"/>')
    if len(topic.times) > 2:
        steps = np.diff(topic.times)
        for at in np.flatnonzero(steps > max(LONG, TIMES * float(np.median(steps))))[:BINS].tolist():
            x0, x1 = (_x(float(topic.times[k]), first, span) for k in (at, at + 1))
            said = f"{steps[at]:.1f} s without a message"
            parts.append(
                f'<rect x="{x0:.1f}" y="{y}" width="{max(x1 - x0, 1):.1f}" height="{HEIGHT}" fill="#b3261e" '
                f'fill-opacity="0.35"><title>{said}</title></rect>'
            )
    return parts


def _axis(height: int, first: float, span: float, zero: float) -> list[str]:
    apart = next((tick for tick in TICKS if span / tick <= 10), span / 10)
    parts = []
    for k in range(int(np.ceil((first - zero) / apart)), int(np.floor((first + span - zero) / apart)) + 1):
        x = _x(zero + k * apart, first, span)
        parts.append(f'<line x1="{x:.1f}" y1="0" x2="{x:.1f}" y2="{height - 18}" stroke="#000" stroke-opacity="0.12"/>')
        parts.append(f'<text x="{x:.1f}" y="{height - 4}" text-anchor="middle">{k * apart:g} s</text>')
    return parts


def _x(at: float, first: float, span: float) -> float:
    return LEFT + (WIDTH - LEFT) * min(max((at - first) / span, 0.0), 1.0)


def _findings(findings: Sequence[Finding]) -> str:
    if not findings:
        return "<p>Nothing.</p>"
    rows = [
        f'<tr><td class="grade {f.grade}">{f.grade}</td><td>{_text(f.about)}</td><td>{_text(f.text)}</td>'
        f"<td>{_text(f.do)}</td></tr>"
        for f in findings
    ]
    head = "<tr><th>grade</th><th>about</th><th>what</th><th>what to do</th></tr>"
    return f"<table>{head}{''.join(rows)}</table>"


def _table(heading: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    head = f"<tr>{''.join(f'<th>{_text(cell)}</th>' for cell in heading)}</tr>" if heading else ""
    body = "".join(
        "<tr>" + "".join(f"<td{_kind(cell)}>{_text(cell)}</td>" for cell in cells) + "</tr>" for cells in rows
    )
    return f"<table>{head}{body}</table>"


def _kind(cell: str) -> str:
    return ' class="number"' if cell[:1].isdigit() and len(cell) < 14 else ""


def _text(text: str) -> str:
    return html.escape(printable(text))


def _shortened(name: str) -> str:
    return name if len(name) <= 28 else f"{name[:12]}…{name[-15:]}"
