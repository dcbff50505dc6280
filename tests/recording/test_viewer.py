"""The recording as the viewer shows it: headless, where a Vulkan driver (a software one will do) is installed."""

import functools
import io
import os
import shutil
import socket
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from synthetic import drive, heard, steps

from pipeline.config import Config
from pipeline.recording import rerun_sink
from pipeline.recording.raw_log import write_raw_log
from pipeline.recording.run_folder import create
from pipeline.replay import replay

DRIVERS = [Path("/usr/share/vulkan/icd.d"), Path("/etc/vulkan/icd.d")]
needs_vulkan = pytest.mark.skipif(
    not any(folder.is_dir() and any(folder.glob("*.json")) for folder in DRIVERS),
    reason="no Vulkan driver: apt-get install libvulkan1 mesa-vulkan-drivers",
)
PATIENCE = 60.0  # seconds


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def showing(tmp_path, monkeypatch):
    """Opens a file in a viewer without a screen, and waits until it is loaded."""
    from rerun.experimental import ViewerClient

    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("CI", "1")  # no analytics
    monkeypatch.setenv("HOME", str(tmp_path))
    assert shutil.which("rerun")

    @contextmanager
    def show(path: Path):
        with ViewerClient.spawn(headless=True, port=free_port(), hide_welcome_screen=True) as viewer:
            viewer.open(str(path))
            settled(viewer, lambda state: state.recordings and state.recordings[0].timelines and state.views)
            yield viewer

    return show


def settled(viewer, what) -> bool:
    until = time.monotonic() + PATIENCE
    while (state := viewer.get_state()).loading or not what(state):
        if time.monotonic() > until:
            return False
        time.sleep(0.2)
    return True


def reports(viewer) -> dict[str, object]:
    """What views complain of; while static data is still on its way they may, but they must settle."""
    settled(viewer, lambda state: not any(view.reports for view in state.views))
    return {view.name: view.reports for view in viewer.get_state().views if view.reports}


@needs_vulkan
@pytest.mark.parametrize("tab", [0, *(pytest.param(tab, marks=pytest.mark.slow) for tab in (1, 2))])
def test_no_view_reports_an_error(tmp_path, monkeypatch, showing, tab):
    monkeypatch.setattr(rerun_sink, "blueprint", functools.partial(rerun_sink.blueprint, tab=tab))
    log = drive(60)
    path = tmp_path / "run.rrd"
    with rerun_sink.RerunSink(path, log=log, config=Config(), seed=0) as sink:
        for step in heard(log, steps(log, 100), reversed_in=range(25, 35)):
            sink.log(step)
        sink.finish({"converged_at": 3.0})

    with showing(path) as viewer:
        assert {"scan", "t"} <= {timeline.name for timeline in viewer.get_state().recordings[0].timelines}
        for scan in (0, 30, 59):
            viewer.set_time("scan", sequence=scan, play_state="paused")
            picture = viewer.take_screenshot()
            assert picture.startswith(b"\x89PNG")
        assert {"Map, flat", "Wheels and laser apart; 1: the limit of chance", "All events", "The sensor model"} <= {
            view.name for view in viewer.get_state().views
        }
        assert reports(viewer) == {}


def pictures(viewer, view, times, timeline, name) -> list[np.ndarray]:
    """A view at these times, once it stands still."""
    found = []
    for at in times:
        viewer.set_time(timeline, **{name: at}, play_state="paused")
        assert reports(viewer) == {}
        before, now = None, seen(viewer, view)
        until = time.monotonic() + PATIENCE
        while (before is None or (before != now).any()) and time.monotonic() < until:
            time.sleep(0.3)
            before, now = now, seen(viewer, view)
        found.append(now)
    return found


def seen(viewer, view) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(viewer.take_screenshot(view.view_id))).convert("RGB"), np.int16)


def changed(a: np.ndarray, b: np.ndarray) -> float:
    """The share of the pixels that differ."""
    return float((np.abs(a - b).max(axis=-1) > 40).mean())


@needs_vulkan
@pytest.mark.parametrize(
    "found", [pytest.param(False, id="log", marks=pytest.mark.slow), pytest.param(True, id="result")]
)
def test_an_mcap_shows_the_map_and_the_robot_moving(office, tmp_path, showing, found):
    path = office.path
    if found:
        path = tmp_path / "result.mcap"
        start = tuple(office.ground_truth.poses[0].tolist())  # a cloud all over the map would change more than a robot
        quick = Config(max_particles=300, init="pose", initial_pose=start, recovery="none", record_particles=40)
        replay(office, quick, create("office", tmp_path / "run"), mcap=path, record=False)
    with showing(path) as viewer:
        (view,) = viewer.get_state().views
        early, late = pictures(viewer, view, (1.0, 60.0), "message_log_time", "timestamp")
        white = (early.min(axis=-1) > 230).mean()
        assert white > 0.02  # the map's floor
        assert 0 < changed(early, late) < 0.1  # the robot, and particles


@needs_vulkan
def test_a_log_shows_the_map_and_the_robot_moving(office, tmp_path, showing):
    path = tmp_path / "log.rrd"
    write_raw_log(path, office)
    with showing(path) as viewer:
        views = {view.name: view for view in viewer.get_state().views}
        assert set(views) == {"Map", "Odometry", "What you see"}
        for view in (views["Map"], views["Odometry"]):
            early, late = pictures(viewer, view, (1.0, 60.0), "t", "duration")
            assert 0 < changed(early, late) < 0.05
