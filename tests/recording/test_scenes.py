"""What is read back as arrays is what the steps held."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import building, drive

from pipeline.errors import MclError
from pipeline.geometry import wrap_angle
from pipeline.recording import entities, palette
from pipeline.recording.columns import DISPLAY_STEP
from pipeline.recording.rerun_sink import BATCH
from pipeline.recording.rrd_file import RrdFile, read_rrd
from pipeline.recording.scenes import Ragged, read_scenes


def test_scenes_hold_what_was_drawn(record):
    run = record(scans=150, particles=40, log=drive(150, origin=(-10.0, 5.0, 0.3)), summary={})
    scenes = read_scenes(run.file)
    assert scenes.scans.tolist() == list(range(150))
    assert np.allclose(scenes.times, run.log.times, atol=1e-9)
    assert np.allclose(scenes.truth[:, :2], run.log.ground_truth.poses[:, :2], atol=DISPLAY_STEP)
    assert np.allclose(wrap_angle(scenes.truth[:, 2] - run.log.ground_truth.poses[:, 2]), 0.0, atol=1e-5)
    for row in (0, 20, 70, 149):
        step = run.steps[row]
        assert (scenes.estimates[row] == step.estimate.pose).all()
        drawn = scenes.particles[row][np.lexsort(scenes.particles[row].T)]
        assert np.allclose(np.sort(drawn[:, 0]), np.sort(step.particles[:, 0]), atol=DISPLAY_STEP)
        levels = palette.weight_levels(step.log_weights, np.arange(40))
        assert np.sort(scenes.levels[row]).tolist() == np.sort(levels).tolist()
        beams = step.beams
        returned = np.isfinite(beams.measured)
        angle, reach = beams.laser[2] + beams.angles[returned], beams.measured[returned]
        ends = beams.laser[:2] + reach[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        drawn = np.concatenate([scenes.hits[row], scenes.shorts[row], scenes.longs[row]])
        assert len(drawn) == len(ends)
        assert np.hypot(*(ends[:, None] - drawn[None]).T).min(axis=0).max() < 3 * DISPLAY_STEP
        assert len(scenes.expected[row]) == np.isfinite(beams.expected).sum()
        assert len(scenes.no_return[row]) == 1
        assert scenes.curves["ess"][row] == step.ess
    assert scenes.labels[20] == ("A 60 %", "B 40 %")
    assert len(scenes.hypotheses[20]) == 2
    assert len(scenes.hypotheses[149]) == 0
    assert not scenes.joined[0]
    assert scenes.joined[1:].sum() > 140


def test_the_map_is_that_of_the_log(record):
    scenes = read_scenes(record(scans=3, log=drive(3, origin=(-10.0, 5.0, 0.3))).file)
    grid = building((-10.0, 5.0, 0.3))
    assert (scenes.grid.known == grid.known).all()
    assert scenes.grid.origin == pytest.approx(grid.origin)
    assert np.allclose(scenes.grid.occupancy[grid.known], grid.occupancy[grid.known], atol=1 / 255)


def test_a_file_cut_anywhere_has_scenes_up_to_the_cut(record, tmp_path):
    whole = record(scans=150).path.read_bytes()
    seen = []
    for share in (0.5, 0.8, 0.95):
        path = tmp_path / f"{share}.rrd"
        path.write_bytes(whole[: int(len(whole) * share)])
        scenes = read_scenes(read_rrd(path))
        assert len(scenes.particles) == len(scenes.hits) == len(scenes.labels) == len(scenes)
        seen.append(len(scenes))
    assert seen == sorted(seen)


def test_chunks_may_come_in_any_order(record):
    file = record(scans=150).file
    backwards = read_scenes(RrdFile(file.application_id, file.recording_id, file.chunks[::-1]))
    forwards = read_scenes(file)
    assert (backwards.estimates == forwards.estimates).all()
    assert (backwards.particles.values == forwards.particles.values).all()


def test_without_scans_or_map_it_says_so(record):
    file = record(scans=5).file
    for left_out, said in (("/record/estimate", "no scans"), ("/world/map", "no map")):
        chunks = tuple(c for c in file.chunks if c.entity_path != left_out)
        with pytest.raises(MclError, match=said):
            read_scenes(RrdFile("mcl", "x", chunks))


def test_rows_that_are_missing_are_empty():
    rows = Ragged(np.arange(6), np.array([0, 2, 2, 6]))
    picked = rows.at(np.array([2, -1, 0, 1]))
    assert [picked[k].tolist() for k in range(4)] == [[2, 3, 4, 5], [], [0, 1], []]
    empty = Ragged(np.empty((0, 2)), np.zeros(1, np.int64))
    assert len(empty.at(np.array([-1, -1]))) == 2


def test_curves_stop_where_the_log_is_silent(record):
    log = drive(150)
    stamps = log.stamps.copy()
    stamps[BATCH:] += 30_000_000_000  # between two batches
    stamps[BATCH + 4 :] += 500_000_000  # late, but nothing was missed
    run = record(scans=150, particles=40, log=replace(log, stamps=stamps), summary={})
    stops = [c for c in run.file.chunks if c.entity_path == entities.EXPLAINED and "scan" not in c.timeline_names]
    (batch,) = (chunk.to_record_batch() for chunk in stops if not chunk.is_static)
    assert batch["t"].cast("int64").to_pylist() == [int(stamps[BATCH - 1] - stamps[0]) + 1]
    assert batch["Scalars:scalars"].to_pylist() == [[]]
    curves = read_scenes(run.file).curves
    assert all(len(curve) == 150 and np.isfinite(curve).all() for curve in curves.values())
