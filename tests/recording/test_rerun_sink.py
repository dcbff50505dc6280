"""What a recording holds is what the steps held."""

import dataclasses
import itertools
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from synthetic import building, drive, steps

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.filter.step import Step
from pipeline.recording import entities, palette
from pipeline.recording.columns import DISPLAY_STEP
from pipeline.recording.rerun_sink import BATCH, RerunSink

RERUN = Path(sys.executable).with_name("rerun")


def compare(a: Path, b: Path) -> int:
    return subprocess.run([RERUN, "rrd", "compare", a, b], capture_output=True, env={"CI": "1"}).returncode


def test_every_scan_is_there_on_both_timelines(record):
    run = record(scans=150)
    for entity in (entities.PARTICLES, entities.RECORD, entities.ESTIMATE, entities.PATH, entities.ESS, entities.LASER):
        scans = run.column(entity, entities.SCAN)
        times = np.array(run.column(entity, entities.TIME)) / 1e9
        assert scans == list(range(150)), entity
        assert np.allclose(times, run.log.times, rtol=0, atol=1e-9)


def test_the_record_is_exact(record):
    run = record()
    stamps = [row[0] for row in run.column(entities.RECORD, f"{entities.RECORD_TYPE}:stamp")]
    poses = np.array(run.column(entities.RECORD, f"{entities.RECORD_TYPE}:pose"))
    covariances = np.array(run.column(entities.RECORD, f"{entities.RECORD_TYPE}:covariance"))
    assert stamps == run.log.stamps.tolist()
    assert (poses == [s.estimate.pose for s in run.steps]).all()
    assert (covariances == [s.estimate.covariance.ravel() for s in run.steps]).all()


def test_particles_are_those_of_the_step(record):
    run = record(scans=70, particles=40)
    positions = run.column(entities.PARTICLES, "Points3D:positions")
    vectors = run.column(entities.PARTICLES, "Arrows3D:vectors")
    colours = run.column(entities.PARTICLES, "Points3D:colors")
    for step, xyz, arrows, packed in zip(run.steps, positions, vectors, colours, strict=True):
        headings = np.rad2deg(np.arctan2(np.array(arrows)[:, 1], np.array(arrows)[:, 0]))
        drawn = zip(*np.round(np.array(xyz)[:, :2].T / DISPLAY_STEP), np.round(headings) % 360, packed, strict=True)
        rgb = palette.WEIGHT_COLOURS[palette.weight_levels(step.log_weights, np.arange(40))].astype(np.uint32)
        rgba = (rgb[:, 0] << 24) + (rgb[:, 1] << 16) + (rgb[:, 2] << 8) + 255
        x, y, yaw = step.particles.astype(np.float64).T
        true = zip(*np.round([x / DISPLAY_STEP, y / DISPLAY_STEP]), np.round(np.rad2deg(yaw)) % 360, rgba, strict=True)
        assert sorted(drawn) == sorted(true)


def test_no_more_particles_than_asked_for(record):
    run = record(scans=10, particles=100, record_particles=30)
    drawn = run.column(entities.PARTICLES, "Points3D:positions")
    assert [len(row) for row in drawn] == [30] * 10
    assert run.column(entities.PARTICLE_COUNT, "Scalars:scalars") == [[100.0]] * 10


@pytest.mark.parametrize(("at_most", "drawn"), [(6, [5, 6, 1]), (0, [0, 0, 0])])
def test_numbers_of_particles_may_change(record, at_most, drawn):
    log = drive(3)
    seen = [next(itertools.islice(steps(log, count), k, None)) for k, count in enumerate((5, 9, 1))]
    run = record(log=log, seen=seen, record_particles=at_most)
    assert [len(row) for row in run.column(entities.PARTICLES, "Points3D:positions")] == drawn
    assert run.column(entities.PARTICLE_COUNT, "Scalars:scalars") == [[5.0], [9.0], [1.0]]


def test_rays_are_as_measured_and_told_apart_as_the_model_explains_them(record):
    """Something in the way of every fifth beam; every seventh finds an open door; the others hit."""
    log = drive(20)
    seen = [_with_people_and_doors(step) for step in steps(log, 50)]
    run = record(log=log, seen=seen)
    drawn = [run.column(e, "LineStrips3D:strips") for e in (entities.HITS, entities.SHORTS, entities.LONGS)]
    lost = run.column(entities.NO_RETURN, "LineStrips3D:strips")
    expected = run.column(entities.EXPECTED, "Points3D:positions")
    for step, *kinds, stubs, points in zip(run.steps, *drawn, lost, expected, strict=True):
        beams = step.beams
        beam, returned = np.arange(len(beams.angles)), np.isfinite(beams.measured)
        short, long = returned & (beam % 5 == 0), returned & (beam % 5 != 0) & (beam % 7 == 0)
        for rays, chosen in zip(kinds, (returned & ~short & ~long, short, long), strict=True):
            tips = np.array(rays)[:, 1]
            assert np.allclose(np.linalg.norm(tips, axis=-1), beams.measured[chosen], atol=DISPLAY_STEP)
            assert np.allclose(np.arctan2(tips[:, 1], tips[:, 0]), beams.angles[chosen], atol=0.02)
        assert len(stubs) == np.isposinf(beams.measured).sum() == 1
        assert np.allclose(np.linalg.norm(points, axis=-1), beams.expected, atol=DISPLAY_STEP)


def _with_people_and_doors(step: Step) -> Step:
    beam, expected = np.arange(len(step.beams.angles)), step.beams.expected
    measured = np.where(np.isfinite(step.beams.measured), expected, step.beams.measured)
    measured = np.where(beam % 7 == 0, measured + np.float32(2.0), measured)
    measured = np.where(beam % 5 == 0, np.where(np.isfinite(measured), 0.4 * expected, measured), measured)
    return dataclasses.replace(step, beams=dataclasses.replace(step.beams, measured=measured.astype(np.float32)))


def test_curves_and_events(record):
    run = record()
    for entity, name in (
        (entities.ESS, "ess"), (entities.LIKELIHOOD, "mean_likelihood"),
        (entities.EXPLAINED, "explained"), (entities.SPREAD, "spread"),
    ):  # fmt: skip
        assert [row[0] for row in run.column(entity, "Scalars:scalars")] == [getattr(s, name) for s in run.steps]
    texts = [row[0] for row in run.column(entities.EVENTS, "TextLog:text")]
    assert texts == [event.text for step in run.steps for event in step.events]
    assert len(texts) == 3


def test_path_is_not_joined_across_jumps(record):
    run = record(scans=150)
    segments = run.column(entities.PATH, "LineStrips3D:strips")
    assert segments[0] == []
    for before, step, segment in zip(run.steps, run.steps[1:], segments[1:], strict=False):
        jumped = np.hypot(*(step.estimate.pose - before.estimate.pose)[:2]) > 1.0
        assert len(segment) == (0 if jumped else 1)
        if segment:
            assert np.allclose(
                np.array(segment[0])[:, :2], [before.estimate.pose[:2], step.estimate.pose[:2]], atol=0.01
            )


def test_other_hypotheses_carry_their_weight(record):
    run = record(scans=150)
    labels = run.column(entities.SHARES, "Points3D:labels")
    assert [len(row) for row in labels] == [len(s.clusters) if len(s.clusters) > 1 else 0 for s in run.steps]
    assert labels[20] == ["A 60 %", "B 40 %"]


def test_hypotheses_after_a_gap_are_named_if_they_have_a_share_worth_reading(record):
    seen = list(steps(drive(60), 40))
    estimate, other = seen[8].clusters
    named = (
        (estimate, 0.6, "did not move"),
        (other, 0.38, "carried off to 3, 4"),
        (other, 0.02, "carried off to 9, 9"),
    )
    clusters = tuple(dataclasses.replace(each, weight=weight, name=name) for each, weight, name in named)
    seen[8] = dataclasses.replace(seen[8], clusters=clusters)
    labels = record(seen=seen, log=drive(60)).column(entities.SHARES, "Points3D:labels")
    assert labels[8] == ["A 60 %, did not move", "B 38 %, carried off to 3, 4", "2 %"]
    assert labels[9] == ["A 60 %", "B 40 %"]


def test_the_shares_can_be_read_whatever_the_ellipses_colour(record):
    run = record(scans=150)
    assert run.column(entities.SHARES, "Points3D:labels")[20] == ["A 60 %", "B 40 %"]
    (colour,) = run.column(entities.SHARES, "Points3D:colors", static=True)
    assert colour[0] >> 8 == int.from_bytes(bytes(palette.LETTERING), "big")


def test_the_truth_is_not_joined_where_somebody_carried_the_robot(record):
    log = drive(150)
    poses = log.ground_truth.poses.copy()
    poses[25:, 0] += 6.0
    carried = dataclasses.replace(log, ground_truth=dataclasses.replace(log.ground_truth, poses=poses))
    drawn = record(scans=150, log=carried).column(entities.TRUTH_PATH, "LineStrips3D:strips")
    assert [k for k, segment in enumerate(drawn) if not segment] == [0, 25]


def test_truth_is_drawn_where_it_is_known(record):
    with_truth, without = record("a.rrd", scans=20), record("b.rrd", log=drive(20, truth=False))
    drawn = np.array(with_truth.column(entities.TRUTH, "Transform3D:translation"))[:, 0, :2]
    assert np.allclose(drawn, with_truth.log.ground_truth.poses[:, :2], atol=DISPLAY_STEP)
    assert without.column(entities.TRUTH, "Transform3D:translation") == []


def test_map_is_right_way_up_and_in_its_place(record):
    origin = (-10.0, 5.0, 0.3)
    run = record(log=drive(5, origin=origin))
    (cells,) = run.column(entities.MAP, "GridMap:data", static=True)
    (place,) = run.column(entities.MAP, "GridMap:translation", static=True)
    grid = building(origin)
    picture = np.frombuffer(bytes(cells[0]), np.uint8).reshape(grid.height, grid.width)
    assert place[0] == [-10.0, 5.0, 0.0]
    bottom_row_of_cells = picture[-1 - 20]  # row 20 is the lower outer wall
    assert (bottom_row_of_cells[20:260] == 0).all()
    assert picture[0, 0] == palette.UNKNOWN[0]


def test_equal_runs_compare_as_equal_whatever_they_took(record):
    summary = {"converged_at": 8.6, "timings": {"start": 2.0, "filter": 1.0}}
    a = record("a.rrd", summary=summary)
    b = record("b.rrd", summary=summary | {"timings": {"start": 0.5, "filter": 2.0}})
    other = record("c.rrd", summary=summary | {"converged_at": 9.0})
    assert compare(a.path, b.path) == 0
    assert compare(a.path, other.path) != 0
    assert a.file.recording_id == b.file.recording_id


def test_recording_id_tells_log_configuration_and_seed_apart():
    log = drive(2)
    ids = {
        entities.recording_id(log, Config(), 0),
        entities.recording_id(log, Config(), 1),
        entities.recording_id(log, Config(max_beams=7), 0),
    }
    assert len(ids) == 3


def test_steps_may_reuse_their_arrays(record, tmp_path):
    kept = record("kept.rrd", scans=6)
    particles = np.empty((40, 3), np.float32)
    path = tmp_path / "reused.rrd"
    with RerunSink(path, log=kept.log, config=kept.config, seed=0) as sink:
        for step in kept.steps:
            particles[:] = step.particles
            sink.log(dataclasses.replace(step, particles=particles))
            particles[:] = np.nan
    assert compare(kept.path, path) == 0


def test_never_overwrites(record, tmp_path):
    run = record(scans=3)
    with pytest.raises(MclError, match="never overwritten"):
        RerunSink(run.path, log=run.log, config=run.config, seed=0)
    with pytest.raises(MclError, match="does not exist"):
        RerunSink(tmp_path / "nowhere" / "run.rrd", log=run.log, config=run.config, seed=0)


def test_needs_a_map(tmp_path):
    log = dataclasses.replace(drive(2), grid=None)
    with pytest.raises(MclError, match="no map"):
        RerunSink(tmp_path / "run.rrd", log=log, config=Config(), seed=0)


@pytest.mark.parametrize(("number", "whole"), [(signal.SIGTERM, True), (signal.SIGINT, True), (signal.SIGKILL, False)])
def test_stopped_runs_can_be_read(tmp_path, number, whole):
    from pipeline.inspect import inspect

    script = textwrap.dedent("""
        import signal, sys, time
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
        sys.path.insert(0, sys.argv[2])
        from synthetic import drive, steps
        from pipeline.config import Config
        from pipeline.recording.rerun_sink import BATCH, RerunSink
        log = drive(100)
        with RerunSink(sys.argv[1], log=log, config=Config(), seed=0) as sink:
            for step in steps(log, 20):
                sink.log(step)
            print("ready", flush=True)
            time.sleep(60)
    """)
    path = tmp_path / "run.rrd"
    command = [sys.executable, "-c", script, path, Path(__file__).parent]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as run:
        assert run.stdout.readline() == "ready\n"
        run.send_signal(number)
    found = inspect(path)
    assert found.scans == (100 if whole else BATCH)
    assert bool(found.damage) != whole
    verified = subprocess.run([RERUN, "rrd", "verify", path], capture_output=True, env={"CI": "1"}).returncode == 0
    assert verified == whole


def test_blueprint_travels_in_the_file(record):
    from rerun.chunk import RrdReader

    assert len(RrdReader(record(scans=3).path).blueprints()) == 1
