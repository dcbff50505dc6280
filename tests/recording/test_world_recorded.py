"""What a recording holds of the verdict on every scan, and of what became known of the world."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from synthetic import drive, steps

from pipeline.filter.step import Step
from pipeline.inspect import inspect
from pipeline.judgement.verdict import KINDS, Verdict
from pipeline.recording import columns, entities, palette
from pipeline.recording.columns import DISPLAY_STEP
from pipeline.recording.rerun_sink import BATCH
from pipeline.recording.rrd_file import read_rrd
from pipeline.recording.scenes import read_scenes

SPANS = (("lost", 0), ("ambiguous", 20), ("found", 30), ("off the map", BATCH), ("found", BATCH + 25))
"""Verdicts, and the scans from which on they hold: also one that changes where a batch begins, and one within it."""
SCANS = 150


def verdict_at(scan: int) -> Verdict:
    kind = [kind for kind, since in SPANS if since <= scan][-1]
    return Verdict(kind, 0.5 + 0.002 * scan)  # type: ignore[arg-type]


def cells(n: int) -> np.ndarray:
    """So many cells that are otherwise: x, y in the map frame, and how."""
    rng = np.random.default_rng(n)
    return np.column_stack([rng.uniform(3, 20, (n, 2)), 1 + np.arange(n) % 3]).astype(np.float32)


CHANGED = {10: cells(4), 70: cells(9), 71: cells(0), 149: cells(2)}


@pytest.fixture
def judged() -> list[Step]:
    plain = steps(drive(SCANS), 20)
    return [dataclasses.replace(s, verdict=verdict_at(s.index), changed=CHANGED.get(s.index)) for s in plain]


def test_the_verdict_is_a_state_from_where_it_changes(record: Callable[..., Any], judged: list[Step]) -> None:
    run = record(scans=SCANS, seen=judged)
    assert run.column(entities.VERDICT, entities.SCAN) == [since for _, since in SPANS]
    said = [row[0] for row in run.column(entities.VERDICT, "StateChange:state")]
    assert said == [kind for kind, _ in SPANS]
    curve = [row[0] for row in run.column(entities.PROBABILITY, "Scalars:scalars")]
    assert curve == [step.verdict.probability for step in judged]


def test_what_is_not_as_mapped_is_drawn_where_more_is_known(record: Callable[..., Any], judged: list[Step]) -> None:
    """In place of what was known before; also that nothing is otherwise any more."""
    run = record(scans=SCANS, seen=judged)
    assert run.column(entities.CHANGED, entities.SCAN) == list(CHANGED)
    points, colours = (run.column(entities.CHANGED, f"Points3D:{name}") for name in ("positions", "colors"))
    for xyz, packed, drawn in zip(points, colours, CHANGED.values(), strict=True):
        assert len(xyz) == len(packed) == len(drawn)
        np.testing.assert_allclose(np.array(xyz).reshape(-1, 3)[:, :2], drawn[:, :2], atol=DISPLAY_STEP)
        rgb = palette.CHANGED_COLOURS[drawn[:, 2].astype(int)].astype(np.uint32)
        assert packed == ((rgb[:, 0] << 24) + (rgb[:, 1] << 16) + (rgb[:, 2] << 8) + 255).tolist()


def test_what_is_not_as_mapped_is_read_back(record: Callable[..., Any], judged: list[Step]) -> None:
    scenes = read_scenes(read_rrd(record(scans=SCANS, seen=judged).path))
    assert scenes.changed_at.tolist() == list(CHANGED)
    assert scenes.changed.lengths.tolist() == [len(drawn) for drawn in CHANGED.values()]
    np.testing.assert_allclose(scenes.changed.values, np.concatenate(list(CHANGED.values())), atol=DISPLAY_STEP)


def test_the_three_ways_to_be_otherwise_have_three_colours() -> None:
    assert len({tuple(colour) for colour in palette.CHANGED_COLOURS[1:]}) == 3


def test_nothing_new_leaves_no_row(record: Callable[..., Any]) -> None:
    run = record(scans=30)
    assert run.column(entities.CHANGED, "Points3D:positions") == []
    assert len(read_scenes(read_rrd(run.path)).changed) == 0


def test_verdicts_are_read_back(record: Callable[..., Any], judged: list[Step]) -> None:
    found = inspect(record(scans=SCANS, seen=judged).path)
    assert [KINDS[k] for k in found.verdicts] == [step.verdict.kind for step in judged]
    assert found.probabilities.tolist() == [step.verdict.probability for step in judged]
    there = found.pose_at(float(found.times[BATCH + 6]))
    assert (there.verdict, there.probability) == ("off the map", judged[BATCH + 6].verdict.probability)
    rows = dict(found.summary_rows())
    shares = [sum(s.verdict.kind == kind for s in judged) / SCANS for kind in KINDS]
    told = ", ".join(f"{kind} {100 * share:.0f} %" for kind, share in zip(KINDS, shares, strict=True))
    assert rows["scans by verdict"] == told
    assert rows["at the end"] == "found, right with probability 0.80"


def test_a_recording_from_before_there_were_verdicts_is_read_without(
    record: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = columns._record
    later = ("verdict", "probability")
    monkeypatch.setattr(
        columns, "_record", lambda s: [c for c in whole(s) if not c.component_descriptor().component.endswith(later)]
    )
    found = inspect(record(scans=30).path)
    assert found.scans == 30
    assert (len(found.verdicts), len(found.probabilities)) == (0, 0)
    there = found.pose_at(float(found.times[7]))
    assert (there.verdict, there.probability) == (None, None)
    assert not {"scans by verdict", "at the end"} & set(dict(found.summary_rows()))
