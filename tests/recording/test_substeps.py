"""The parts of a filter's turn are recorded as they happened, on a timeline of their own, and change nothing."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.filter.substeps import SubStep, SubSteps
from pipeline.localization import localize
from pipeline.logs.messages import Log
from pipeline.recording import entities
from pipeline.recording.columns import DISPLAY_STEP
from pipeline.recording.rerun_sink import RerunSink
from pipeline.recording.rrd_file import RrdFile, read_rrd
from pipeline.recording.substeps import MOST, PLOT, in_words, write_substeps

SCANS, FIRST, LAST = 60, 8.0, 10.0


@pytest.fixture(scope="module")
def drive(office: Log) -> Log:
    """The first scans of the sample, in which the robot has begun to drive."""
    columns = ("stamps", "odometry", "ranges")
    return dataclasses.replace(office, **{name: getattr(office, name)[:SCANS] for name in columns})


def config(log: Log, **options: object) -> Config:
    """A few particles about the true place."""
    assert log.ground_truth is not None
    pose = tuple(log.ground_truth.poses[0].tolist())
    few = {"init": "pose", "initial_pose": pose, "max_particles": 300, "min_particles": 300, "recovery": "none"}
    return Config(**{"adaptive": "none", "odometry": "wheels", **few, **options})  # type: ignore[arg-type]


def told(log: Log, settings: Config, first: float = FIRST, last: float = LAST) -> list[SubStep]:
    steps: list[SubStep] = []
    localize(log, settings, seed=3, substeps=SubSteps(log, first, last, steps.append))
    return steps


@pytest.fixture(scope="module")
def steps(drive: Log) -> list[SubStep]:
    return told(drive, config(drive))


def rows(file: RrdFile, entity: str, component: str) -> list[tuple[int, object]]:
    batches = [chunk.to_record_batch() for chunk in file.chunks if chunk.entity_path == entity and not chunk.is_static]
    tables = [pa.Table.from_batches([batch]) for batch in batches if component in batch.schema.names]
    found = [
        (row, value)
        for table in tables
        if entities.SUBSTEP in table.column_names
        for row, value in zip(table[entities.SUBSTEP].to_pylist(), table[component].to_pylist(), strict=True)
    ]
    return sorted(found, key=lambda each: each[0])


def test_looking_changes_nothing(drive: Log):
    alone = localize(drive, config(drive), seed=3)
    seen: list[SubStep] = []
    watched = localize(drive, config(drive), seed=3, substeps=SubSteps(drive, 0.0, 99.0, seen.append))
    assert seen
    assert watched.poses.tobytes() == alone.poses.tobytes()
    assert watched.covariances.tobytes() == alone.covariances.tobytes()


def test_a_turn_is_resampling_if_it_is_due_then_predicting_then_weighing(steps: Sequence[SubStep], drive: Log):
    by_scan: dict[int, list[str]] = {}
    for step in steps:
        assert FIRST <= step.time == drive.times[step.scan] <= LAST
        by_scan.setdefault(step.scan, []).append(step.kind)
    assert len(by_scan) > 5
    assert set(map(tuple, by_scan.values())) == {("resample", "predict", "weigh"), ("predict", "weigh")}


def test_the_first_scan_is_weighed(drive: Log):
    first = told(drive, config(drive), 0.0, 0.0)
    assert [step.kind for step in first] == ["weigh"]
    assert len(first[0].poses) == 300


@pytest.mark.parametrize("resampler", ["low_variance", "multinomial"])
def test_the_parts_of_a_turn_fit_together(drive: Log, resampler: str):
    turns = told(drive, config(drive, resampler=resampler))
    draws = 0
    for before, after in itertools.pairwise(turns):
        if after.kind == "resample":
            draws += 1
            assert (after.poses == before.poses).all()
            assert (after.weights == before.weights).all()
            # What survives is what the places on the cumulative weights say.
            chosen = np.searchsorted(np.cumsum(after.weights), after.teeth)
            assert np.mean(chosen == after.ancestors) > 0.99  # rounding of the sum may decide otherwise
            assert (np.diff(after.teeth) > 0).all()
        if after.kind == "predict":
            survivors = before.poses[before.ancestors] if before.kind == "resample" else before.poses
            assert np.allclose(after.before, survivors)
            assert not np.allclose(after.before, after.poses)
        if after.kind == "weigh":
            assert (after.poses == before.poses).all()
            assert after.weights.sum() == pytest.approx(1.0)
            assert not np.allclose(after.weights, before.weights)
    assert draws > 1


def test_a_grid_has_none(drive: Log):
    with pytest.raises(MclError, match="this filter has none"):
        told(drive, config(drive, filter="grid"))


def test_they_are_in_the_recording_beside_all_else(drive: Log, tmp_path: Path):
    settings, path = config(drive), tmp_path / "run.rrd"
    seen: list[SubStep] = []
    with RerunSink(path, log=drive, config=settings, seed=3, substeps=True) as sink:

        def log(step: SubStep) -> None:
            seen.append(step)
            sink.log_substep(step)

        parts = SubSteps(drive, FIRST, LAST, log)
        localize(drive, settings, seed=3, sinks=[sink], substeps=parts)
    file = read_rrd(path)
    assert not file.damage
    kinds = rows(file, entities.SUBSTEP_KIND, "StateChange:state")
    assert [(k, [step.kind]) for k, step in enumerate(seen)] == kinds
    scans = [chunk for chunk in file.chunks if chunk.entity_path == entities.RECORD]
    assert all(entities.SUBSTEP not in chunk.timeline_names for chunk in scans)


def test_arrows_dots_and_the_comb_are_those_of_the_sub_step(drive: Log, steps: Sequence[SubStep], tmp_path: Path):
    path = tmp_path / "steps.rrd"
    assert drive.grid is not None
    write_substeps(path, "steps", drive.grid, steps, np.full((len(steps), 3), np.nan))
    file = read_rrd(path)
    assert file.application_id == entities.LESSON_ID
    dots = dict(rows(file, entities.SUBSTEP_PARTICLES, "Points3D:positions"))
    radii = dict(rows(file, entities.SUBSTEP_PARTICLES, "Points3D:radii"))
    starts = dict(rows(file, entities.SUBSTEP_MOVES, "Arrows3D:origins"))
    arrows = dict(rows(file, entities.SUBSTEP_MOVES, "Arrows3D:vectors"))
    teeth = dict(rows(file, entities.COMB_TEETH, "LineStrips2D:strips"))
    stairs = dict(rows(file, entities.COMB_WEIGHTS, "LineStrips2D:strips"))
    texts = dict(rows(file, entities.SUBSTEP_TEXT, "TextDocument:text"))
    for k, step in enumerate(steps):
        drawn = {tuple(np.round(np.array(dot[:2]) / DISPLAY_STEP)) for dot in dots[k]}
        assert drawn == {tuple(np.round(pose[:2].astype(np.float64) / DISPLAY_STEP)) for pose in step.poses}
        assert texts[k] == [in_words(step)]
        if step.kind == "predict":
            ends = np.array(starts[k]) + np.array(arrows[k])
            assert np.allclose(np.array(starts[k])[:, :2], step.before[:, :2], atol=DISPLAY_STEP)
            assert np.allclose(ends[:, :2], step.poses[:, :2], atol=DISPLAY_STEP)
        else:
            assert not arrows[k]
            (line,) = stairs[k]
            heights = 1.0 - np.array(line)[:, 1] / PLOT[1]
            assert heights[0] == 0.0
            assert heights[-1] == pytest.approx(1.0, abs=1e-5)
            assert (np.diff(heights) >= -1e-6).all()
        if step.kind == "resample":
            assert len(teeth[k]) == min(len(step.teeth), MOST)
            copies = np.bincount(step.ancestors, minlength=len(step.poses))
            assert len(set(radii[k])) == len(set(copies[copies > 0])) + (copies == 0).any()
            assert f"{np.count_nonzero(copies):,} survive" in texts[k][0]


def test_more_particles_than_can_be_seen_are_thinned(drive: Log, tmp_path: Path):
    assert drive.grid is not None
    rng, n = np.random.default_rng(0), 5 * MOST
    poses = rng.uniform(3.0, 9.0, (n, 3)).astype(np.float32)
    weights = np.full(n, 1.0 / n)
    teeth = (np.arange(n) + 0.5) / n
    step = SubStep("resample", 4, 1.0, poses, weights, ancestors=np.arange(n, dtype=np.int32), teeth=teeth)
    write_substeps(tmp_path / "many.rrd", "many", drive.grid, [step], np.full((1, 3), np.nan))
    file = read_rrd(tmp_path / "many.rrd")
    ((_, dots),) = rows(file, entities.SUBSTEP_PARTICLES, "Points3D:positions")
    ((_, lines),) = rows(file, entities.COMB_TEETH, "LineStrips2D:strips")
    assert len(dots) == len(lines) == MOST
    assert (tmp_path / "many.rrd").stat().st_size < 2_000_000
