"""What a recording says in words at a scan, and the figures beside it."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader
from synthetic import drive, steps

from pipeline.config import Config
from pipeline.filter.beam_model import Mixture, mixture_density
from pipeline.filter.step import Event, Step
from pipeline.judgement.verdict import Verdict
from pipeline.recording import entities
from pipeline.recording.captions import Captions, Error, error, two_sigma
from pipeline.recording.layout import AXIS
from pipeline.recording.scales import Scales
from pipeline.recording.scenes import read_scenes
from pipeline.recording.sensor_parts import BINS, PARTS, SensorParts
from pipeline.recording.side_by_side import Shown, write_run
from pipeline.recording.told_columns import FINE, WORST

NEAR, FAR, TURNED = Error(0.1, 0.01), Error(8.3, 0.1), Error(0.1, 3.0)
LAST = 39


@pytest.fixture(scope="module")
def seen() -> list[Step]:
    return list(steps(drive(LAST + 1), 40))


def judged(step: Step, kind: str, **more: Any) -> Step:
    return dataclasses.replace(step, verdict=Verdict(kind, 0.5), events=(), spread=0.1, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("kind", "missed", "more", "said"),
    [
        ("found", NEAR, {}, "FOUND: it knows where it is, and its place follows"),
        ("found", None, {}, "FOUND: it knows where it is, and its place follows"),
        ("found", NEAR, {"short": 0.43}, "something stands in the way of 43 % of the beams"),
        ("found", NEAR, {"through": 0.2}, "20 % of the beams go through mapped walls"),
        ("found", FAR, {}, "WRONG, and does not know it: it is 8.3 m away"),
        ("off the map", TURNED, {}, "WRONG, and does not know it: it is turned by 172°"),
        ("off the map", NEAR, {}, "OFF THE MAP"),
        ("ambiguous", FAR, {}, "AMBIGUOUS: a few places"),
        ("lost", FAR, {"off_map": 0.9}, "LOST OFF THE MAP"),
        ("lost", FAR, {}, "LOST: not found yet; it is sought"),
        ("lost", FAR, {"heat": np.zeros((1, 3), np.float32)}, "LOST: not found yet; the whole map is being searched"),
    ],
)
def test_the_headline_says_what_is_the_matter(seen, kind, missed, more, said):
    caption = Captions().caption(judged(seen[LAST], kind, **more), missed)
    assert said in caption.splitlines()[0]
    assert (str(missed) in caption) == (missed is not None)


def test_who_was_carried_off_does_not_know_it_until_it_does(seen):
    captions = Captions()
    found, lost = judged(seen[LAST], "found"), judged(seen[LAST], "lost")
    assert captions.caption(found, NEAR).startswith("# FOUND")
    at = f"{found.time:.0f} s"
    assert f"CARRIED OFF at {at}, and does not know it yet: it is 8.3 m" in captions.caption(found, FAR, carried=True)
    assert f"LOST: carried off at {at}; it is sought" in captions.caption(lost, FAR)
    assert captions.caption(found, NEAR).startswith("# FOUND")
    assert captions.caption(found, FAR).startswith("# WRONG")
    assert "LOST: it was known before" in captions.caption(lost, FAR)


def test_without_the_truth_missing_scans_tell_that_it_may_have_been_carried(seen):
    captions = Captions()
    gap = dataclasses.replace(judged(seen[LAST], "lost"), events=(Event("gap", "20 s are missing.", "WARN"),))
    assert f"perhaps carried off before {gap.time:.0f} s" in captions.caption(gap, None)
    assert captions.caption(judged(seen[LAST], "found"), None).startswith("# FOUND")
    assert "perhaps" not in captions.caption(judged(seen[LAST], "lost"), None)


def test_places_in_question_are_named_with_their_shares(seen):
    two = next(step for step in seen if len(step.clusters) > 1)
    caption = Captions().caption(judged(two, "ambiguous"), None)
    assert "AMBIGUOUS: 2 places explain" in caption
    assert "A 60 %, B 40 %" in caption


def test_what_happened_is_a_table_with_the_newest_first(record):
    run = record(scans=150)
    tables = [row[0].splitlines() for row in run.column(entities.EVENTS_TABLE, "TextDocument:text")]
    happened = [(step, event) for step in run.steps for event in step.events]
    assert run.column(entities.EVENTS_TABLE, entities.SCAN) == [step.index for step, _ in happened]
    for k, table in enumerate(tables):
        rows = [f"| {s.time:.1f} s | {e.kind} | {e.text} |" for s, e in reversed(happened[: k + 1])]
        assert table == ["| time | what | why |", "|---|---|---|", *rows]


def test_error_and_two_sigma_are_those_of_the_estimate(record):
    run = record(scans=150)
    truth = run.log.ground_truth.poses
    wrong = [row[0] for row in run.column(entities.ERROR, "Scalars:scalars")]
    off = [np.hypot(*(s.estimate.pose - truth[s.index])[:2]) for s in run.steps]
    assert np.allclose(wrong, off, rtol=0, atol=FINE)
    sigmas = [row[0] for row in run.column(entities.TWO_SIGMA, "Scalars:scalars")]
    assert np.allclose(sigmas, [2 * np.sqrt(s.estimate.covariance[0, 0]) for s in run.steps], rtol=0, atol=FINE)
    assert two_sigma(run.steps[-1].estimate) == pytest.approx(0.5)


def test_a_turn_is_counted_the_short_way_round():
    missed = error(np.array([1.0, 2.0, 3.1]), np.array([1.0, 2.4, -3.1]))
    assert (missed.distance, missed.turn) == pytest.approx((0.4, 2 * np.pi - 6.2))
    assert missed.right


def test_without_the_truth_nothing_is_said_of_the_error(record):
    run = record(log=drive(40, truth=False))
    assert run.column(entities.ERROR, "Scalars:scalars") == []
    captions = [row[0] for row in run.column(entities.CAPTION, "TextDocument:text")]
    assert len(captions) == 40
    assert not any("truth" in caption for caption in captions)


def test_the_two_robots_have_names_while_they_are_apart(record):
    run = record(scans=150)
    off = np.array(
        [np.hypot(*(s.estimate.pose - p)[:2]) for s, p in zip(run.steps, run.log.ground_truth.poses, strict=True)]
    )
    changes = np.flatnonzero(np.diff(off > 0.5, prepend=False)).tolist()
    for entity, name in ((entities.ESTIMATE_NAME, "believed here"), (entities.TRUTH_NAME, "truly here")):
        assert run.column(entity, entities.SCAN) == changes
        assert run.column(entity, "Points3D:labels") == [[name] if off[k] > 0.5 else [] for k in changes]


def test_a_silence_of_the_log_is_told_in_place_of_the_last_scan(record):
    log = drive(40)
    stamps = log.stamps + np.where(np.arange(40) < 20, 0, 30_000_000_000)
    run = record(log=dataclasses.replace(log, stamps=stamps))
    (silence,) = [
        chunk.to_record_batch()
        for chunk in run.file.chunks
        if chunk.entity_path == entities.CAPTION and not chunk.is_static and entities.SCAN not in chunk.timeline_names
    ]
    assert "no scans for 30 s" in silence["TextDocument:text"][0].as_py()[0]
    assert silence[entities.TIME].cast("int64").to_pylist() == [int(stamps[19] - stamps[0]) + 1]


def test_the_beams_that_the_map_explains_least_are_marked(record):
    log = drive(5)
    away = np.array([3, 9, 14, 20, 25, 30])
    wrong = []
    for step in steps(log, 20):
        measured = np.where(np.isfinite(step.beams.measured), step.beams.expected, step.beams.measured)
        measured[away] += np.float32(2.0) + 0.1 * np.arange(len(away), dtype=np.float32)
        wrong.append(dataclasses.replace(step, beams=dataclasses.replace(step.beams, measured=measured)))
    run = record(log=log, seen=wrong)
    for step, marked in zip(wrong, run.column(entities.WORST, "Points3D:positions"), strict=True):
        far = np.linalg.norm(np.array(marked)[:, :2], axis=1)
        assert np.allclose(far, step.beams.measured[away[::-1][:WORST]], atol=0.01)


def test_the_parts_of_the_sensor_model_add_up_and_the_log_is_counted_beside_them():
    config = Config()
    parts = SensorParts(config, Mixture(config, 20.0), 20.0)
    charts = {name: chart.values.as_arrow_array()[0].as_py()["buffer"] for name, chart in parts.model().items()}
    heights = {name: np.array(values) for name, values in charts.items()}
    z = np.linspace(0.0, 2 * parts.wall, 20001)
    whole = np.trapezoid(mixture_density(z, np.full_like(z, parts.wall), config, 20.0), z)
    assert heights["1_hit"].sum() == pytest.approx(100 * whole, abs=0.2)
    assert (np.diff([heights[name][:BINS] for name in PARTS], axis=0) <= 0).all()
    assert heights["5_no_return"][-1] == pytest.approx(100 * config.z_max)
    assert parts.shares().measured is None

    step = next(steps(drive(2), 5))
    beams = dataclasses.replace(
        step.beams,
        expected=np.full(5, parts.wall, np.float32),
        measured=np.array([parts.wall, parts.wall, 1.0, np.inf, np.nan], np.float32),
    )
    parts.hear([dataclasses.replace(step, beams=beams, verdict=Verdict("lost", 0.0))])
    assert parts.seen == 0
    parts.hear([dataclasses.replace(step, beams=beams, verdict=Verdict("found", 1.0))])
    assert parts.shares().measured.tolist() == [50.0, 25.0, 0.0, 0.0, 25.0]


def test_axes_have_room_for_the_run_and_not_for_its_first_second():
    spread, wrong = np.full(100, 0.4), np.full(100, 0.1)
    spread[:5], wrong[:5] = 13.0, np.nan
    scales = Scales.of({entities.SPREAD: spread, entities.ERROR: wrong, entities.TWO_SIGMA: wrong / 2})
    assert (scales.spread, scales.error) == (0.5, 0.25)
    assert scales.likelihood is None


def test_a_run_that_ends_corrects_its_axes_in_the_one_layout_of_its_file(record, tmp_path):
    def axes(path) -> list[float]:
        reader = RrdReader(path)
        (layout,) = reader.blueprints()
        batches = [c.to_record_batch() for c in reader.stream(store=layout).to_chunks() if c.entity_path.endswith(AXIS)]
        return [row[0][1] for b in batches for row in b["ScalarAxis:range"].to_pylist()]

    killed, ended = record("a.rrd"), record("b.rrd", summary={})
    scales = Scales.of_chunks(ended.file.chunks)
    assert scales.spread in axes(ended.path)
    assert scales.spread not in axes(killed.path)
    again = tmp_path / "again.rrd"
    write_run(again, Shown("a", killed.file, read_scenes(killed.file)))
    assert scales.spread in axes(again)
