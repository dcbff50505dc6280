"""Two runs beside each other: what differs, when they part, and one recording of both."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parent / "recording"))

from synthetic import drive, steps

from pipeline.cli import app
from pipeline.compare import FIGURES, Track, compare, figures, read_compared, record, table, track_errors
from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.export.run import read_run
from pipeline.logs.messages import Trajectory
from pipeline.logs.tum import read_tum, write_tum
from pipeline.recording.rerun_sink import RerunSink
from pipeline.recording.rrd_file import read_rrd
from pipeline.recording.side_by_side import Shown, called, write_side_by_side


def write(path, *, seed=0, noise=0, log=None, **parameters):
    log = log or drive(150)
    with RerunSink(path, log=log, config=Config(**parameters), seed=seed) as sink:
        for step in steps(log, 30, seed=noise):
            sink.log(step)
        sink.finish({"converged_at": 9.2, "timings": {"start": 0.5, "filter": 1.5}})
    return path


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    """The same log twice, with other parameters and other noise; and another log."""
    folder = tmp_path_factory.mktemp("runs")
    return (
        write(folder / "a.rrd", sigma_hit=0.1),
        write(folder / "b.rrd", sigma_hit=0.3, max_particles=5000, seed=4, noise=1),
        write(folder / "c.rrd", log=replace(drive(80, truth=False, start=5), sha256="1" * 64)),
    )


@pytest.fixture(scope="module")
def runs(paths):
    return tuple(read_run(path) for path in paths)


@pytest.fixture
def typed():
    return lambda *args: CliRunner().invoke(app, [str(arg) for arg in args])


def test_figures_are_those_of_the_run(runs):
    found = figures(runs[0])
    told, truth = runs[0].told, runs[0].scenes.truth
    error = np.hypot(*(told.poses[:, :2] - truth[:, :2]).T)
    assert (found.scans, found.seed, found.lost, found.found, found.wall) == (150, 0, 1, 0, 2.0)
    assert found.converged_at == told.converged_at
    assert found.error == pytest.approx(np.median(error[told.times >= told.converged_at]))
    assert found.end_error == pytest.approx(error[-1])
    assert figures(runs[2]).error is None


def test_what_a_recording_does_not_tell_is_a_dash(runs):
    known = runs[0]
    curves = known.scenes.curves | {"particles": np.full(150, np.nan)}
    never = [event for event in known.told.events if event.kind != "converged"]
    run = replace(known, told=replace(known.told, events=tuple(never)), scenes=replace(known.scenes, curves=curves))
    shown = {name: show(figures(run)) for name, show in FIGURES}
    assert (shown["converged"], shown["error"], shown["particles"]) == ("never", "-", "-")
    assert shown["at the end"] != "-"


def test_a_run_is_never_apart_from_itself(runs):
    found = compare(runs[0], runs[0])
    assert (found.apart, found.config, found.same_log, found.same_map) == ((), {}, True, True)
    assert found.common == 150
    assert not found.distances.any()


def test_parameters_that_differ_are_named(runs):
    found = compare(runs[0], runs[1])
    assert found.config == {"sigma_hit": (0.1, 0.3), "max_particles": (Config().max_particles, 5000)}


def test_it_is_known_when_and_how_far_they_part(runs):
    a = runs[0]
    poses = a.told.poses.copy()
    poses[40:60, 0] += np.linspace(2.0, 5.0, 20)
    poses[100:, 2] += np.deg2rad(30.0)
    b = replace(a, told=replace(a.told, poses=poses))
    first, second = compare(a, b).apart
    assert (first.begin, first.end) == (a.told.times[40], a.told.times[59])
    assert (first.distance, first.most) == (pytest.approx(2.0), pytest.approx(5.0))
    assert (second.begin, second.end) == (a.told.times[100], a.told.times[149])
    assert np.rad2deg(second.turn) == pytest.approx(30.0)


def test_logs_without_a_common_stamp_can_be_compared(runs):
    found = compare(runs[0], runs[2])
    assert (found.common, found.apart, found.same_log) == (0, (), False)
    json.dumps(found.to_dict())


def test_a_table_tells_of_every_run_what_differs_and_what_came_out(runs):
    told = table(runs)
    assert list(told)[:2] == ["log", "seed"]
    assert {"sigma_hit", "max_particles", "error", "converged"} <= set(told)
    assert told["sigma_hit"] == ("0.1", "0.3", f"{Config().sigma_hit:g}")
    assert told["error"][2] == "-"


def test_one_recording_shows_both(runs, tmp_path):
    path = tmp_path / "both.rrd"
    write_side_by_side(path, [Shown(run.name, run.file, run.scenes) for run in runs[:2]], apart={})
    there = {chunk.entity_path for chunk in read_rrd(path).chunks}
    assert {"/A/world/particles", "/B/world/particles", "/A/world/map", "/all/A/path", "/all/B/robot"} <= there
    assert not any("timings" in entity for entity in there)
    with pytest.raises(MclError, match="exists already"):
        write_side_by_side(path, [], apart={})


def test_runs_of_the_same_name_are_told_apart_by_their_parameters(runs):
    alike = [Shown("log, seed 0", run.file, run.scenes) for run in runs[:2]]
    most = Config().max_particles
    assert called(alike) == [
        f"A: log, seed 0, max_particles {most}, sigma_hit 0.1",
        "B: log, seed 0, max_particles 5000, sigma_hit 0.3",
    ]
    assert called([alike[0], replace(alike[1], name="other")]) == ["A: log, seed 0", "B: other"]
    assert called([alike[0], alike[0]]) == ["A: log, seed 0", "B: log, seed 0"]


def test_a_whole_copy_of_a_damaged_recording_can_be_made(paths, tmp_path):
    (tmp_path / "cut.rrd").write_bytes(paths[0].read_bytes()[:-40_000])
    cut = read_run(tmp_path / "cut.rrd")
    assert cut.told.damage
    record([cut], tmp_path / "whole.rrd")
    whole = read_run(tmp_path / "whole.rrd")
    assert (whole.told.damage, whole.told.recording_id) == ("", cut.told.recording_id)
    assert (whole.told.poses == cut.told.poses).all()


def test_different_maps_are_not_laid_over_each_other(runs, tmp_path):
    other = read_run(write(tmp_path / "d.rrd", log=drive(20, origin=(5.0, 0.0, 0.0))))
    shown = [Shown(run.name, run.file, run.scenes) for run in (runs[0], other)]
    write_side_by_side(tmp_path / "both.rrd", shown, apart={})
    assert not any(chunk.entity_path.startswith("/all") for chunk in read_rrd(tmp_path / "both.rrd").chunks)


def test_compare_as_it_is_typed(typed, paths, tmp_path):
    done = typed("compare", paths[0], paths[1], "-o", tmp_path / "both.rrd")
    assert done.exit_code == 0
    assert done.stderr.splitlines()[-1].endswith(f"rerun {tmp_path / 'both.rrd'}")
    assert done.stdout.splitlines()[-1] == str(tmp_path / "both.rrd")
    assert "sigma_hit" in done.stdout
    assert "/apart/distance/B" in {chunk.entity_path for chunk in read_rrd(tmp_path / "both.rrd").chunks}
    again = typed("compare", paths[0], paths[1], "-o", tmp_path / "both.rrd")
    assert (again.exit_code, "exists already" in again.stderr) == (1, True)
    (tmp_path / "cut.rrd").write_bytes(paths[0].read_bytes()[:-40_000])
    assert "cut.rrd: cut short" in typed("compare", tmp_path / "cut.rrd", paths[1]).stderr
    told = json.loads(typed("compare", paths[0], paths[2], "--json").stdout)
    assert (told["common_scans"], told["same_log"]) == (0, False)


def test_a_recording_of_both_is_not_one_run(typed, runs, tmp_path):
    path = tmp_path / "both.rrd"
    record(runs[:2], path)
    for words in (("inspect", path), ("export", path, "-o", tmp_path / "a.png"), ("compare", path, path)):
        done = typed(*words)
        assert done.exit_code == 1
        assert "several runs side by side" in done.stderr


def test_a_recording_of_both_is_viewed_as_it_is(typed, paths, runs, tmp_path, monkeypatch):
    path, shown = tmp_path / "both.rrd", []
    record(runs[:2], path)
    monkeypatch.setattr("pipeline.recording.viewer.show", shown.append)
    assert typed("view", path).exit_code == 0
    assert shown == [path]
    assert typed("view", path, paths[0]).exit_code == 1


def test_inspect_of_several_runs_is_a_table(typed, paths):
    done = typed("inspect", *paths)
    assert done.exit_code == 0
    lines = done.stdout.splitlines()
    assert [line.split() for line in lines[1:4]] == [
        [letter, str(path)] for letter, path in zip("ABC", paths, strict=True)
    ]
    assert lines[5].split() == ["A", "B", "C"]
    assert ["seed", "0", "4", "0"] in [line.split() for line in lines]
    assert all(len(line) <= 80 for line in lines[4:])
    told = json.loads(typed("inspect", "--json", *paths).stdout)
    assert [row["config"]["sigma_hit"] for row in told] == [0.1, 0.3, Config().sigma_hit]
    assert typed("inspect", *paths, "--at", "3").exit_code == 2


def test_of_many_runs_each_has_a_row_and_what_is_alike_is_told_once(typed, paths):
    many = [*paths[:2]] * 4
    lines = typed("inspect", *many).stdout.splitlines()
    heading = next(line for line in lines if line.split()[:1] == ["run"])
    assert [line.split()[0] for line in lines[lines.index(heading) + 1 :]] == [str(path) for path in many]
    assert "sigma_hit" in heading
    assert not {"log", "scans"} & set(heading.split())
    assert ["scans", "150"] in [line.split() for line in lines[: lines.index(heading)]]


def tum(path, run, *, rows=slice(None), shift=0.0):
    poses = run.told.poses[rows].copy()
    poses[:, 0] += shift
    write_tum(path, Trajectory(run.told.stamps[rows], poses))
    return path


def test_the_way_of_another_filter_is_compared_at_the_scans(runs, tmp_path):
    a = runs[0]
    every_other = read_tum(tum(tmp_path / "amcl.tum", a, rows=slice(20, 131, 2), shift=0.7))
    found = compare(a, Track("amcl.tum", every_other))
    assert found.common == 111
    assert found.distances == pytest.approx(0.7, abs=0.1)  # between two poses the way is straight
    assert [(s.begin, s.end) for s in found.apart] == [(a.told.times[20], a.told.times[130])]
    assert found.config == {}
    told = found.figures[1]
    assert (told.log, told.seed, told.lost, told.scans) == ("amcl.tum", None, None, 111)
    error = track_errors(Track("amcl.tum", every_other), a)[0]
    since = a.told.times[20:131] >= a.told.converged_at
    assert told.error == pytest.approx(np.nanmedian(error[since]))
    json.dumps(found.to_dict())


def test_runs_and_tracks_are_told_apart_by_what_they_hold(paths, runs, tmp_path):
    run = tmp_path / "run.tum"
    run.write_bytes(paths[1].read_bytes())
    track = tum(tmp_path / "track.txt", runs[0])
    a, b, c = read_compared([paths[0], run, track])
    assert (a.seed, b.seed, c.name) == (0, 4, "track.txt")


@pytest.mark.parametrize(
    ("chosen", "said"),
    [
        (["tum", "a"], "the first one is a run"),
        (["a", "tum of c"], "no pose of this file is of the time"),
        (["a"] * 7, "at most 6"),
        (["a", "text"], "text.tum:1: expected 8 numbers"),
        (["a", "nothing"], "nothing"),
        (["a"], "give two runs or more"),
    ],
)
def test_what_cannot_be_compared(typed, paths, runs, tmp_path, chosen, said):
    (tmp_path / "text.tum").write_text("hello\n")
    there = {"a": paths[0], "tum": tum(tmp_path / "a.tum", runs[0]), "tum of c": tum(tmp_path / "c.tum", runs[2]),
             "text": tmp_path / "text.tum", "nothing": tmp_path / "nothing"}  # fmt: skip
    done = typed("compare", *(there[name] for name in chosen), "-o", tmp_path / "all.html")
    assert done.exit_code == (2 if chosen == ["a"] else 1)
    assert said in " ".join(done.stderr.replace("│", " ").split())
    assert not (tmp_path / "all.html").exists()


def test_three_are_compared_on_a_page_and_in_a_recording(typed, paths, runs, tmp_path):
    track = tum(tmp_path / "amcl.tum", runs[0], shift=0.7)
    done = typed("compare", paths[0], paths[1], track, "-o", tmp_path / "all.html")
    assert done.exit_code == 0
    assert done.stdout.splitlines()[-1] == str(tmp_path / "all.html")
    assert "estimates of B and A" in done.stdout
    assert "estimates of C and A are apart, by more than 0.5 m or 10 deg (150 common scans)" in done.stdout
    rows = {line.split()[0]: line.split()[1:] for line in done.stdout.splitlines() if line.strip()}
    assert rows["seed"] == ["0", "4", "-"]
    assert rows["sigma_hit"] == ["0.1", "0.3", "-"]
    assert (tmp_path / "all.html").read_text().startswith("<!doctype html>")
    assert typed("compare", paths[0], track, paths[1], "-o", tmp_path / "all.rrd").exit_code == 0
    there = {chunk.entity_path for chunk in read_rrd(tmp_path / "all.rrd").chunks}
    assert {"/all/A/path", "/all/B/robot", "/all/C/robot", "/apart/distance/B", "/apart/distance/C"} <= there
    assert {"/A/world/particles", "/C/world/particles"} <= there
    assert "/B/world/particles" not in there
    told = json.loads(typed("compare", paths[0], paths[1], track, "--json").stdout)
    assert [pair["b"]["log"] for pair in told] == ["synthetic", "amcl.tum"]
