"""The recording as the viewer shows it: headless, where a Vulkan driver (a software one will do) is installed."""

import functools
import os
import shutil
import socket
import sys
import time
from pathlib import Path

import pytest
from synthetic import DENSITY, drive, steps

from pipeline.config import Config
from pipeline.recording import rerun_sink

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


@needs_vulkan
@pytest.mark.parametrize("tab", [0, 1])
def test_no_view_reports_an_error(tmp_path, monkeypatch, tab):
    from rerun.experimental import ViewerClient

    monkeypatch.setattr(rerun_sink, "blueprint", functools.partial(rerun_sink.blueprint, tab=tab))
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("CI", "1")  # no analytics
    monkeypatch.setenv("HOME", str(tmp_path))
    assert shutil.which("rerun")
    log = drive(60)
    path = tmp_path / "run.rrd"
    with rerun_sink.RerunSink(path, log=log, config=Config(), seed=0, density=DENSITY) as sink:
        for step in steps(log, 100):
            sink.log(step)
        sink.finish({"converged_at": 3.0})

    with ViewerClient.spawn(headless=True, port=free_port(), hide_welcome_screen=True) as viewer:
        viewer.open(str(path))
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            state = viewer.get_state()
            if not state.loading and state.recordings and state.recordings[0].timelines and state.views:
                break
            time.sleep(0.2)
        timelines = {timeline.name: timeline for timeline in state.recordings[0].timelines}
        assert {"scan", "t"} <= set(timelines)
        for scan in (0, 30, 59):
            viewer.set_time("scan", sequence=scan, play_state="paused")
            picture = viewer.take_screenshot()
            assert picture.startswith(b"\x89PNG")
        # While static data is still on its way, a view may complain; it must settle.
        while any(view.reports for view in viewer.get_state().views) and time.monotonic() < deadline:
            time.sleep(0.2)
        views = viewer.get_state().views
        assert {"Map", "Map, flat", "Events"} <= {view.name for view in views}
        assert {view.name: view.reports for view in views if view.reports} == {}
