"""What a recording says in words and in figures that can be checked, as rerun's columns: captions, the table of
events, the error, and which robot on the map is the believed one and which the true."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from pipeline.filter.step import Step
from pipeline.recording import captions, entities, palette
from pipeline.recording.captions import Captions, Error
from pipeline.recording.columns import Columns, IsHit, curve_stops, lift, timelines
from pipeline.recording.truth import Truth

WORST = 5
"""Beams of a scan that are marked because the map explains them least."""
FINE = 1 / 1024  # m, to which errors are rounded: a short number takes fewer bytes
_dot = rr.Radius.ui_points(3.5)
_hidden = rr.Radius.ui_points(0.5)


@dataclass(frozen=True)
class Told:
    """Of a scan: its caption and, where something happened, the table of events, both Markdown; the error, None where
    the truth is unknown; ``two_sigma`` of the position, m; ``silent``: seconds for which nothing was measured before
    it, if they are many."""

    step: Step
    caption: str
    events: str | None
    missed: Error | None
    two_sigma: float
    silent: float | None = None


class Teller:
    """Hears the steps in their order and tells of each."""

    def __init__(self, truth: Truth | None) -> None:
        self._captions = Captions()
        self._truth: dict[int, tuple[NDArray[np.float64], bool]] = {}
        if truth is not None:
            leapt = ~truth[2]
            leapt[0] = False  # before the first it was nowhere
            self._truth = {int(k): (pose, bool(far)) for k, pose, far in zip(truth[0], truth[1], leapt, strict=True)}

    def tell(self, step: Step, silent: float | None) -> Told:
        """Of a step; ``silent``: seconds without a scan before it, if they are many."""
        pose, carried = self._truth.get(step.index, (None, False))
        missed = None if pose is None else captions.error(step.estimate.pose, pose)
        caption = self._captions.caption(step, missed, carried)
        sigmas = captions.two_sigma(step.estimate)
        return Told(step, caption, self._captions.events(step), missed, sigmas, silent)


def told_columns(rows: Sequence[Told], apart: bool, above: float) -> list[Columns]:
    """What these add (at least one); ``apart``: the robots on the map were said to be two before them;
    ``above``: how far above the believed one its name stands, m, since below there are shares."""
    index = timelines([r.step.index for r in rows], [r.step.time for r in rows])
    places = lift(np.stack([r.step.estimate.pose[:2] for r in rows]), 0.0)
    found: list[Columns] = [
        (entities.CAPTION, index, list(rr.TextDocument.columns(text=[r.caption for r in rows]))),
        (entities.HERE, index, list(rr.Transform3D.columns(translation=places))),
        _curve(entities.TWO_SIGMA, [(r.step, r.two_sigma) for r in rows]),
        *_table(rows),
        *_silences(rows),
    ]
    known = [(r.step, r.missed.distance) for r in rows if r.missed is not None]
    if known:
        found.append(_curve(entities.ERROR, known))
    if ends := [r.step.time - r.silent for r in rows if r.silent is not None]:
        found += [curve_stops(entity, ends) for entity in (entities.TWO_SIGMA, *([entities.ERROR] if known else []))]
    return [*found, *_names(rows, apart, above)]


def are_apart(told: Told) -> bool:
    """Whether the believed robot and the true one are drawn at different places."""
    return told.missed is not None and told.missed.distance > captions.RIGHT[0]


def worst_beams(steps: Sequence[Step], is_hit: IsHit) -> Columns:
    """Where the beams end that the map explains least: of those that are no hits, the farthest from what it says."""
    ends = []
    for step in steps:
        beams = step.beams
        measured, expected = beams.measured.astype(np.float64), beams.expected.astype(np.float64)
        told = np.flatnonzero(np.isfinite(measured) & np.isfinite(expected))
        told = told[~is_hit(measured[told], expected[told])]
        far = told[np.argsort(-np.abs(measured[told] - expected[told]), kind="stable")[:WORST]]
        angles = beams.angles[far]
        ends.append(np.column_stack([np.cos(angles), np.sin(angles)]) * measured[far, None])
    index = timelines([s.index for s in steps], [s.time for s in steps])
    points = rr.Points3D.columns(positions=lift(np.concatenate(ends), 0.02)).partition([len(row) for row in ends])
    return (entities.WORST, index, list(points))


def told_styles(truth: bool) -> dict[str, list[Any]]:
    """Static archetypes by entity."""
    markdown = rr.TextDocument.from_fields(media_type=rr.MediaType.MARKDOWN)
    name = rr.Points3D.from_fields(radii=_hidden, colors=palette.LETTERING, show_labels=True)
    found: dict[str, list[Any]] = {
        entities.CAPTION: [markdown],
        entities.EVENTS_TABLE: [markdown],
        entities.WORST: [rr.Points3D.from_fields(radii=_dot, colors=palette.SHORT)],
        entities.TWO_SIGMA: [rr.SeriesLines(colors=palette.NEUTRAL, names="2 sigma, as it believes", widths=1.5)],
    }
    if truth:
        found[entities.ERROR] = [rr.SeriesLines(colors=palette.TRUTH, names="error", widths=2.0)]
        found[entities.TRUTH_NAME] = [name]
        found[entities.ESTIMATE_NAME] = [name]
    return found


def _curve(entity: str, rows: Sequence[tuple[Step, float]]) -> Columns:
    index = timelines([s.index for s, _ in rows], [s.time for s, _ in rows])
    fine = np.round(np.array([value for _, value in rows]) / FINE) * FINE
    return (entity, index, list(rr.Scalars.columns(scalars=fine)))


def _table(rows: Sequence[Told]) -> list[Columns]:
    told = [(r.step, r.events) for r in rows if r.events is not None]
    if not told:
        return []
    index = timelines([s.index for s, _ in told], [s.time for s, _ in told])
    return [(entities.EVENTS_TABLE, index, list(rr.TextDocument.columns(text=[text for _, text in told])))]


def _silences(rows: Sequence[Told]) -> list[Columns]:
    """On the timeline t alone, for among the scans none is missing."""
    told = [(r.step.time - r.silent, r.silent) for r in rows if r.silent is not None]
    if not told:
        return []
    after = np.round(np.array([at for at, _ in told]) * 1e9).astype("timedelta64[ns]") + np.timedelta64(1, "ns")
    texts = [captions.silence(seconds) for _, seconds in told]
    return [
        (entities.CAPTION, [rr.TimeColumn(entities.TIME, duration=after)], list(rr.TextDocument.columns(text=texts)))
    ]


def _names(rows: Sequence[Told], apart: bool, above: float) -> list[Columns]:
    """Names at the two robots, from where they part to where they come together again."""
    changes = []
    for row in rows:
        if are_apart(row) != apart:
            apart = not apart
            changes.append((row.step, apart))
    if not changes:
        return []
    index = timelines([s.index for s, _ in changes], [s.time for s, _ in changes])
    lengths = [int(two) for _, two in changes]

    def named(name: str, y: float) -> list[Any]:
        shown = sum(lengths)
        points = rr.Points3D.columns(positions=[(0.0, y, 0.0)] * shown, labels=[name] * shown)
        return list(points.partition(lengths))

    return [
        (entities.ESTIMATE_NAME, index, named("believed here", above)),
        (entities.TRUTH_NAME, index, named("truly here", 0.0)),
    ]
