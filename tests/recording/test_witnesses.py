"""What a recording says of wheels and laser is what the steps said."""

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import LASER, drive, heard, steps
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.config import Config, load_config
from pipeline.geometry import between, compose
from pipeline.localization import localize
from pipeline.recording import documents, entities
from pipeline.recording.columns import DISPLAY_STEP
from pipeline.recording.rerun_sink import BATCH, RerunSink
from pipeline.recording.rrd_file import read_rrd
from pipeline.recording.statements import Statements
from pipeline.recording.witness_columns import COARSE
from pipeline.recording.witness_views import recorded_tab
from pipeline.recording.witnesses import APART, NEAR, POINTS, thinned

CURVES = (entities.APART, entities.FIT, entities.FOLLOWED)
PLACES = (entities.WAYS, entities.HEADS, entities.WALLS, entities.SAID_WHEELS, entities.SAID_LASER, entities.SAID_SCAN)
BACKWARDS = range(80, 96)


@pytest.fixture
def told(record):
    log = drive(150)
    return record(log=log, seen=list(heard(log, steps(log, 40), reversed_in=BACKWARDS)))


def paths(run):
    """(scans, 3, 2, 2): the segments by the wheels, by the laser and as believed, x and y of their ends."""
    return np.array(run.column(entities.WAYS, "LineStrips3D:strips"))[..., :2]


def test_the_paths_are_those_of_the_witnesses_from_the_same_start(told):
    ways = paths(told)
    assert ways.shape == (150, 3, 2, 2)
    assert (ways[0] == ways[0, 0, 0]).all()
    assert np.allclose(ways[:, 0, 1], [s.motion.odometry[:2] for s in told.steps], atol=DISPLAY_STEP)
    assert np.allclose(ways[:, 1, 1], [s.motion.pose[:2] for s in told.steps], atol=DISPLAY_STEP)
    assert (ways[1:, :, 0] == ways[:-1, :, 1]).all()


def test_what_is_believed_goes_as_the_estimate_once_that_is_sure(told):
    believed = paths(told)[:, 2]
    sure = [s.spread < 0.5 and s.estimate.weight > 0.95 for s in told.steps]
    assert 50 < sum(sure) < 149
    for k in range(1, 150):
        by = [s.estimate.pose for s in told.steps] if sure[k - 1] and sure[k] else told.log.odometry
        assert np.hypot(*(believed[k, 1] - believed[k, 0])) == pytest.approx(
            np.hypot(*(by[k] - by[k - 1])[:2]), abs=2 * DISPLAY_STEP
        )


def test_curves_say_what_the_steps_said(told):
    moved = [s for s in told.steps if s.prior is not None]
    assert len(moved) == 148
    limits = [[2.0 if s.index in BACKWARDS else 0.5, 1.0] for s in moved]
    assert told.column(entities.APART, "Scalars:scalars") == limits
    assert told.column(entities.APART, entities.SCAN) == [s.index for s in moved]
    fits = [[s.motion.laser.fit, s.motion.laser.fit_as_told] for s in told.steps]
    assert told.column(entities.FIT, "Scalars:scalars") == fits
    assert told.column(entities.FOLLOWED, "Scalars:scalars") == [[0.9, 0.1]] * 148


def test_the_disagreement_has_an_end(record):
    log = drive(20)
    seen = list(heard(log, steps(log, 40)))
    far = [
        s if s.prior is None else dataclasses.replace(s, prior=dataclasses.replace(s.prior, disagreement=1e9))
        for s in seen
    ]
    assert record(log=log, seen=far).column(entities.APART, "Scalars:scalars") == [[5.0, 1.0]] * 18


def test_walls_are_those_remembered_before_the_scan_and_lie_where_the_laser_has_them(told):
    scans = told.column(entities.WALLS, entities.SCAN)
    rows = sorted({scan for scan in scans if scan % 4 == 1})
    points = [np.array(p) for p in told.column(entities.WALLS, "Points3D:positions")]
    drawn = [p for p in points if len(p)]
    assert len(drawn) == len(rows) == 38
    for scan, found in zip(rows, drawn, strict=True):
        known = told.steps[scan - 1].walls[:2].T
        assert 0 < len(found) <= POINTS
        nearest = np.abs(found[:, None, :2] - known[None]).max(axis=-1).min(axis=1)
        assert nearest.max() <= COARSE / 2 + 1e-5
    places = np.array(told.column(entities.WALLS, "Transform3D:translation"))[:, 0, :2]
    turns = np.array(told.column(entities.WALLS, "Transform3D:quaternion"))[:, 0]
    frames = np.column_stack([places, 2 * np.arctan2(turns[:, 2], turns[:, 3])])
    lasers = compose(np.array([s.motion.laser.pose for s in told.steps]), LASER.pose)
    assert np.allclose(compose(lasers, frames)[:, :2], 0.0, atol=2 * DISPLAY_STEP)


def arrows(run, entity):
    """Origins and vectors by scan."""
    told = zip(*(run.column(entity, f"Arrows3D:{part}") for part in ("origins", "vectors")), strict=True)
    return dict(zip(run.column(entity, entities.SCAN), told, strict=True))


def test_a_contradiction_is_drawn_over_a_second_and_goes_away(told):
    wheels, laser = (arrows(told, entity) for entity in (entities.SAID_WHEELS, entities.SAID_LASER))
    assert set(wheels) == set(laser) == set(range(80, 101))
    assert wheels[100] == laser[100] == ([], [])
    for scan in range(86, 96):
        begin, now = told.steps[scan - 5], told.steps[scan]
        for said, a, b in (
            (wheels, begin.motion.odometry, now.motion.odometry), (laser, begin.motion.pose, now.motion.pose)
        ):  # fmt: skip
            (start,), (way,) = said[scan]
            assert np.allclose(start[:2], begin.estimate.pose[:2], atol=DISPLAY_STEP)
            tip = compose(begin.estimate.pose, between(a, b))
            assert np.allclose(np.add(start, way)[:2], tip[:2], atol=2 * DISPLAY_STEP)
    labels = told.column(entities.SAID_SHARE, "Points3D:labels")
    assert labels == [["90 % follow the laser"]] * 20 + [[]]
    returned = np.isfinite(told.steps[90].beams.measured).sum()
    assert len(told.column(entities.SAID_SCAN, "Points3D:positions")[10]) == returned


def test_curves_stop_where_the_log_is_silent(record):
    log = drive(40)
    stamps = log.stamps + np.where(np.arange(40) < 20, 0, 30_000_000_000)
    log = dataclasses.replace(log, stamps=stamps)
    run = record(log=log, seen=list(heard(log, steps(log, 40))))
    for entity in CURVES:
        chunks = [c for c in run.file.chunks if c.entity_path == entity and not c.is_static]
        (stop,) = [c.to_record_batch() for c in chunks if entities.SCAN not in c.timeline_names]
        assert stop["Scalars:scalars"].to_pylist() == [[]]
        assert stop[entities.TIME].cast("int64").to_pylist() == [round(log.times[19] * 1e9) + 1]


def test_a_contradiction_across_batches_goes_away_too(record):
    log = drive(BATCH + 6)
    seen = list(heard(log, steps(log, 40), reversed_in=range(BATCH - 14, BATCH - 5)))
    run = record(log=log, seen=seen)
    assert run.column(entities.SAID_WHEELS, entities.SCAN) == list(range(BATCH - 14, BATCH))
    assert run.column(entities.SAID_WHEELS, "Arrows3D:origins")[-1] == []


def test_no_contradiction_across_a_break_of_the_lasers_odometry(record):
    log = drive(30)
    seen = [
        dataclasses.replace(
            s, motion=dataclasses.replace(s.motion, laser=dataclasses.replace(s.motion.laser, stretch=s.index))
        )
        for s in heard(log, steps(log, 40), reversed_in=range(10, 20))
    ]
    assert entities.SAID_WHEELS not in {
        c.entity_path for c in record(log=log, seen=seen).file.chunks if not c.is_static
    }


def test_wheels_alone_leave_a_recording_as_it_was(tmp_path):
    log = drive(70)
    path = tmp_path / "run.rrd"
    config = Config(odometry="wheels")
    with RerunSink(path, log=log, config=config, seed=0) as sink:
        for step in steps(log, 40):
            sink.log(step)
    file = read_rrd(path)
    assert not {c.entity_path for c in file.chunks} & {*CURVES, *PLACES, entities.SAID_SHARE}
    assert recorded_tab(file) is None
    assert Statements(file.chunks).at(3) is None
    assert "Wheels and laser" not in documents.explanation(config, laser=False)


def test_the_laser_alone_is_nobody_to_contradict(record):
    log = dataclasses.replace(drive(70), wheels=False)
    run = record(log=log, seen=list(heard(log, steps(log, 40), wheels=False)))
    assert paths(run).shape == (70, 2, 2, 2)
    assert run.column(entities.FIT, "Scalars:scalars") == [[0.9]] * 70
    assert run.column(entities.FOLLOWED, "Scalars:scalars") == [[0.9, 0.1]] * 68
    drawn = {c.entity_path for c in run.file.chunks}
    assert not drawn & {entities.APART, entities.SAID_WHEELS, entities.SAID_LASER, entities.SAID_SCAN}
    assert recorded_tab(run.file) is not None
    assert Statements(run.file.chunks).at(30).wheels is None


def test_inspect_says_what_they_said(told):
    found = Statements(told.file.chunks).at(90)
    a, b = told.steps[89].motion, told.steps[90].motion
    assert np.allclose(found.laser, between(a.pose, b.pose), atol=0.02)
    assert np.allclose(found.wheels, between(a.odometry, b.odometry), atol=0.02)
    assert (found.apart, found.fit, found.fit_by_wheels, found.follows_laser) == (2.0, 0.9, 0.3, 0.9)
    at = ["inspect", str(told.path), "--at", f"{told.steps[90].time + 0.01:.3f}"]
    _, judged, said = CliRunner().invoke(app, at).stdout.splitlines()
    assert judged == "found: right with probability 1.00"
    assert said == found.sentence
    assert "backwards" in said
    assert "by the laser 90 %, by the wheels 30 %; 90 % of the belief follows the laser" in said
    answer = json.loads(CliRunner().invoke(app, [*at, "--json"]).stdout)
    assert answer["witnesses"]["fit"] == 0.9
    assert Statements(told.file.chunks).at(0) is None


def test_the_texts_name_every_colour():
    both, laser = documents.explanation(Config()), documents.explanation(Config(), wheels=False)
    assert all(word in both for word in ("brown line", "blue line", "magenta line", "black dots", "brown dots"))
    assert "brown line" not in laser
    assert "blue line" in laser


@given(st.integers(0, 2**32 - 1), st.integers(0, 4000))
@settings(max_examples=30, deadline=None)
def test_thinned_points_are_few_and_apart(seed, count):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-20, 20, (count, 2)).astype(np.float32)
    centre = rng.uniform(-5, 5, 2)
    kept = thinned(points, centre)
    assert len(kept) <= POINTS
    assert {tuple(p) for p in kept.tolist()} <= {tuple(p) for p in points.tolist()}
    squares = np.floor(kept / np.float32(APART))
    assert len(np.unique(squares, axis=0)) == len(kept)
    assert (np.hypot(*(kept - centre).T) < NEAR + 1e-3).all()


def test_a_real_run_grows_by_no_more_than_a_sixth(office, tmp_path):
    """The same steps with and without what the witnesses said, of the embedded building."""
    kept = []

    class Keep:
        def log(self, step):
            assert step.walls is not None
            assert not step.walls.flags.writeable
            assert (step.followed is None) == (step.prior is None)
            if step.followed is not None:
                assert len(step.followed) == len(step.prior.components)
                assert step.followed.sum() == pytest.approx(1.0)
            copies = {name: getattr(step, name).copy() for name in ("particles", "log_weights", "walls")}
            kept.append(dataclasses.replace(step, **copies))

    config = load_config().model_copy(update={"max_particles": 500, "min_particles": 500})
    localize(office, config, threads=1, sinks=[Keep()])
    sizes = []
    for name, chosen in (("with", config), ("without", config.model_copy(update={"odometry": "wheels"}))):
        path = tmp_path / f"{name}.rrd"
        with RerunSink(path, log=office, config=chosen, seed=0) as sink:
            for step in kept:
                alone = dataclasses.replace(step.motion, laser=None)
                sink.log(step if name == "with" else dataclasses.replace(step, motion=alone))
        sizes.append(path.stat().st_size)
    assert sizes[0] < 7 / 6 * sizes[1]
