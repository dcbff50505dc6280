"""What a script or a notebook does with `import pipeline as mcl`: steps that stay as they were, short reprs, tables."""

from __future__ import annotations

import base64
import dataclasses
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import pipeline as mcl
from pipeline.world.seen import Seen

QUICK = mcl.Config(max_particles=300, min_particles=300, init="free_space", recovery="none", record_particles=10)


def deep(value: object, depth: int = 0) -> Iterator[np.ndarray]:
    """All arrays that can be reached from a value."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, tuple | list):
        for each in value:
            yield from deep(each, depth + 1)
    elif dataclasses.is_dataclass(value) and depth < 6:
        for field in dataclasses.fields(value):
            yield from deep(getattr(value, field.name), depth + 1)


@pytest.fixture(scope="module")
def short(office: mcl.Log) -> mcl.Log:
    return dataclasses.replace(office.part(slice(0, 60)), ground_truth=office.ground_truth)


@pytest.fixture(scope="module")
def result(short: mcl.Log) -> mcl.RunResult:
    return mcl.localize(short, seed=1)


@pytest.fixture(scope="module")
def recorded(short: mcl.Log, tmp_path_factory: pytest.TempPathFactory) -> mcl.Run:
    run = mcl.record_run(short, QUICK, tmp_path_factory.mktemp("runs") / "first", seed=2)
    return mcl.read_run(run.folder.path)


@pytest.mark.parametrize("filter_name", ["mcl", "grid"])
def test_no_step_changes_once_it_was_handed_out(short: mcl.Log, filter_name: str) -> None:
    """Neither those that are iterated over nor those that a sink is shown; whatever can be reached from them."""

    class Keep:
        def __init__(self) -> None:
            self.steps: list[mcl.Step] = []
            self.then: list[list[np.ndarray]] = []

        def log(self, step: mcl.Step) -> None:
            self.steps.append(step)
            self.then.append([array.copy() for array in deep(step)])

    few = dataclasses.replace(short.part(slice(0, 12 if filter_name == "grid" else 60)))
    config = mcl.load_config(None, [f"filter={filter_name}", "grid_d=1.0", "max_particles=5000"])
    shown, walked = Keep(), Keep()
    mcl.localize(few, config, seed=1, sinks=[shown])
    for step in mcl.Localizer(few, config, seed=1):
        walked.log(step)
    assert len(shown.steps) == len(walked.steps) == len(few)
    for keep in (shown, walked):
        for step, then in zip(keep.steps, keep.then, strict=True):
            now = list(deep(step))
            assert len(now) == len(then) > 8
            for a, b in zip(now, then, strict=True):
                np.testing.assert_array_equal(a, b)
    with pytest.raises(ValueError, match="read-only"):
        shown.steps[0].particles[0] = 0.0


def test_the_filters_own_steps_do_change(short: mcl.Log) -> None:
    """Which is why whoever stands outside gets copies: without them the test above would have to fail."""
    run = mcl.Localizer(short, mcl.Config(max_particles=5000), seed=1)
    scans = short.scans()
    first = run._update(next(scans))
    then = first.particles.copy()
    for scan in scans:
        run._update(scan)
    assert not np.array_equal(first.particles, then)


def test_stepping_gives_what_a_whole_run_gives(short: mcl.Log, result: mcl.RunResult) -> None:
    run = mcl.Localizer(short, seed=1)
    steps = iter(run)
    first = [next(steps) for _ in range(20)]
    assert repr(run) == "Localizer('office', seed 1: 20 of 60 scans done)"
    rest = list(run)  # another loop goes on where the first one stopped
    found = run.finish()
    assert [step.index for step in (*first, *rest)] == list(range(60))
    for name in ("poses", "covariances", "probability", "hindsight", "ess", "stamps"):
        np.testing.assert_array_equal(getattr(found, name), getattr(result, name))
    assert found.events == result.events
    assert isinstance(found.seen, Seen)
    assert run.finish() is found


def test_a_run_that_is_stopped_tells_what_was_found_until_then(short: mcl.Log, result: mcl.RunResult) -> None:
    run = mcl.Localizer(short, seed=1)
    with pytest.raises(mcl.MclError, match="no scan has been localized yet"):
        run.finish()
    for step in run:
        if step.index == 24:
            break
    found = run.finish()
    assert len(found) == 25
    np.testing.assert_array_equal(found.poses, result.poses[:25])
    np.testing.assert_array_equal(found.times, short.times[:25])
    assert list(run) == []
    assert mcl.run_errors(found)[0].shape == (25,)


def test_what_is_done_between_steps_is_no_part_of_the_run(short: mcl.Log, monkeypatch: pytest.MonkeyPatch) -> None:
    class Clock:
        """Every look at it takes a second."""

        now = 0.0

        def perf_counter(self) -> float:
            self.now += 1.0
            return self.now

    clock = Clock()
    monkeypatch.setattr("pipeline.localization.time", clock)
    run = mcl.Localizer(short.part(slice(0, 3)), QUICK)
    for _ in run:
        clock.now += 1000.0
    clock.now += 1000.0
    assert 3.0 <= sum(run.finish().seconds.values()) < 20.0


def test_reprs_are_short_and_tell_what_it_is(short: mcl.Log, result: mcl.RunResult, recorded: mcl.Run) -> None:
    step = next(iter(mcl.Localizer(short, QUICK)))
    done = mcl.evaluate_logs(short, QUICK, runs=1)
    told = [
        (short, "60 scans in 11.7 s"),
        (next(short.scans()), "180 ranges"),
        (short.grid, "330 x 225 cells of 0.1 m"),
        (short.ground_truth, "432 poses"),
        (result, "60 scans in 11.7 s"),
        (result.trajectory, "60 poses"),
        (result.seen, "1 log"),
        (recorded, "'office', seed 2"),
        (recorded.told, "60 scans"),
        (step, "300 particles"),
        (step.estimate, "% of the belief"),
        (step.beams, "nats each"),
        (step.motion, "dead reckoning"),
        (done, "of 1 runs succeed"),
        (done.logs[0], "office"),
        (done.logs[0].runs[0], "seed 0"),
        (mcl.compare_runs(recorded, recorded), "60 common scans, never apart"),
    ]
    for thing, words in told:
        assert words in repr(thing)
        assert len(repr(thing)) < 240
        assert "\n" not in repr(thing)


@pytest.mark.parametrize("what", ["map", "result", "recorded"])
def test_a_notebook_shows_a_picture(what: str, short: mcl.Log, result: mcl.RunResult, recorded: mcl.Run) -> None:
    shown = {"map": short.grid, "result": result, "recorded": recorded}[what]
    html = shown._repr_html_()
    figure = ElementTree.fromstring(html)  # well formed
    svg = "{http://www.w3.org/2000/svg}"
    (image,) = figure.iter(f"{svg}image")
    png = base64.b64decode(image.attrib["href"].removeprefix("data:image/png;base64,"))
    assert png.startswith(b"\x89PNG")
    names = [title.text for title in figure.iter(f"{svg}title")]
    assert ("where it was believed to be" in names) == (what != "map")
    assert len(html) < 200_000
    assert figure.find("figcaption").text == repr(shown)


def test_a_picture_has_the_way_where_the_robot_went(short: mcl.Log, result: mcl.RunResult) -> None:
    """The end of the path, in pixels of the picture, is the end of the run in cells of the map."""
    figure = ElementTree.fromstring(result._repr_html_())
    *_, last = figure.iter("{http://www.w3.org/2000/svg}polyline")
    x, y = (float(number) for number in last.attrib["points"].split()[-1].split(","))
    low, high = short.grid.known_area
    width = float(next(figure.iter("{http://www.w3.org/2000/svg}svg")).attrib["width"])
    scale = width / (high[0] - low[0])
    np.testing.assert_allclose([x / scale + low[0], high[1] - y / scale], result.poses[-1, :2], atol=2 / scale)


def test_names_of_other_people_are_harmless(short: mcl.Log) -> None:
    log = dataclasses.replace(short.part(slice(0, 2)), name="<script>alert(1)</script>\x1b[2J")
    shown = mcl.localize(log, QUICK)
    assert "<script" not in shown._repr_html_()
    assert "&lt;script&gt;" in shown._repr_html_()
    assert "\x1b" not in repr(shown) + repr(log)


def test_without_pandas_one_line_says_so(result: mcl.RunResult, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(mcl.MclError, match=r"pandas is not installed \(pip install 'mcl-replay\[pandas\]'\)"):
        result.to_pandas()


def test_tables_for_pandas(short: mcl.Log, result: mcl.RunResult, recorded: mcl.Run) -> None:
    pytest.importorskip("pandas")
    frame = result.to_pandas()
    assert len(frame) == 60
    np.testing.assert_array_equal(frame[["x", "y", "yaw"]].to_numpy(), result.poses)
    assert frame["verdict"].tolist() == list(result.verdicts)
    frame.loc[0, "x"] = 1e6
    assert result.poses[0, 0] != 1e6  # what a user does to the table is done to the table
    step = next(iter(mcl.Localizer(short, QUICK)))
    assert step.to_pandas()["weight"].sum() == pytest.approx(1.0)
    assert list(result.trajectory.to_pandas()) == ["stamp", "x", "y", "yaw"]
    told = recorded.to_pandas()
    assert len(told) == 60
    np.testing.assert_array_equal(told["x"].to_numpy(), recorded.told.poses[:, 0])
    compared = mcl.compare_configs(short, {"quick": QUICK, "other": QUICK.model_copy(update={"z_hit": 0.5})}, runs=2)
    table = compared.to_pandas()
    assert table["configuration"].tolist() == ["quick", "quick", "other", "other"]
    assert {"log", "seed", "success", "scans_right", "wall"} <= set(table)


def test_a_log_of_any_kind_is_read_as_the_command_line_does(office: mcl.Log) -> None:
    from pipeline.simulate import sample_dir

    raw = mcl.read_log(sample_dir() / "office.log.gz", mcl.load_map(sample_dir() / "office.dat.gz"))
    np.testing.assert_array_equal(raw.ranges, office.ranges)
    assert raw.grid.sha256 == office.grid.sha256
    assert isinstance(raw.remarks, tuple)
    sample = mcl.sample_log()
    np.testing.assert_array_equal(sample.ranges, office.ranges)
    np.testing.assert_array_equal(sample.ground_truth.poses, office.ground_truth.poses)


def test_what_is_drawn_stands_on_the_axes_it_was_given(short: mcl.Log, result: mcl.RunResult, tmp_path: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 4))
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    step = next(iter(mcl.Localizer(short, QUICK)))
    assert mcl.draw_belief(step, short.grid, left) is left
    assert mcl.draw_run(result, right) is right
    (cloud, *_) = [each for each in left.collections if len(each.get_offsets()) == 300]
    np.testing.assert_allclose(np.sort(cloud.get_offsets()[:, 0]), np.sort(step.particles[:, 0]), rtol=1e-6)
    lines = {line.get_label(): line for line in right.lines}
    assert set(lines) == {"truth", "in hindsight", "estimate"}
    x = lines["estimate"].get_xdata()
    np.testing.assert_array_equal(x[~np.isnan(x)], result.poses[:, 0])
    figure.savefig(tmp_path / "both.png")
    assert "found" in left.get_title() or "lost" in left.get_title() or "ambiguous" in left.get_title()
    assert re.fullmatch(r"office, seed 1", right.get_title())


def test_a_run_is_scored_against_any_reference(short: mcl.Log, result: mcl.RunResult) -> None:
    own = mcl.score_run(result)
    assert own == mcl.score_run(result, short.ground_truth)
    far = mcl.Trajectory(short.ground_truth.stamps, short.ground_truth.poses + np.array([100.0, 0.0, 0.0]))
    assert not mcl.score_run(result, far).success
    distance, turn = mcl.run_errors(result, far)
    assert (distance[-1] > 90.0, turn.shape) == (True, (60,))
    unknown = dataclasses.replace(result, log=dataclasses.replace(short, ground_truth=None))
    with pytest.raises(mcl.MclError, match="does not know the truth"):
        mcl.score_run(unknown)


def test_one_configuration_is_no_comparison(short: mcl.Log) -> None:
    with pytest.raises(mcl.MclError, match="two configurations or more"):
        mcl.compare_configs(short, {"only": QUICK})
