"""A run that somebody watches: the viewer gets it, and the file is the same whatever becomes of the viewer."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from synthetic import drive, steps
from test_viewer import PATIENCE, free_port, needs_vulkan
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.recording import viewer
from pipeline.recording.rerun_sink import RerunSink


def write(path: Path, address: str | None, at: int = 0, meanwhile=lambda: None) -> Path:
    log = drive(150)
    with RerunSink(path, log=log, config=Config(), seed=0, viewer=address) as sink:
        for step in steps(log, 50):
            if step.index == at:
                meanwhile()
            sink.log(step)
        sink.finish({"converged_at": 3.0})
    return path


def compared(a: Path, b: Path) -> int:
    return subprocess.run(
        [viewer.program(), "rrd", "compare", a, b], capture_output=True, env=viewer.quiet()
    ).returncode


def test_the_file_is_the_same_with_and_without_a_viewer(listening, tmp_path):
    _, address = listening
    viewer.check_address(address)
    assert compared(write(tmp_path / "a.rrd", address), write(tmp_path / "b.rrd", None)) == 0


def test_a_viewer_that_is_closed_takes_nothing_with_it(listening, tmp_path):
    process, address = listening

    def close() -> None:
        process.kill()
        process.wait()
        with pytest.raises(MclError, match="no viewer answers"):
            viewer.check_address(address)

    assert compared(write(tmp_path / "a.rrd", address, 70, close), write(tmp_path / "b.rrd", None)) == 0


def test_the_program_is_the_viewer_itself_not_a_script_that_starts_it():
    with viewer.program().open("rb") as file:
        assert file.read(2) != b"#!"


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("somewhere", "no address of a viewer"),
        ("http://127.0.0.1:9876/proxy", "no address of a viewer"),
        ("rerun+http://127.0.0.1:x/proxy", "no address of a viewer"),
        ("rerun+http://127.0.0.1:1/proxy", "no viewer answers"),
    ],
)
def test_what_is_no_viewer_is_said_at_once(address, said, tmp_path):
    with pytest.raises(MclError, match=said):
        viewer.check_address(address)
    path = write(tmp_path / "a.rrd", None)
    done = CliRunner().invoke(app, ["view", str(path), "--connect", address])
    assert (done.exit_code, said in done.stderr) == (1, True)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a viewer would open")
def test_without_a_screen_the_viewer_says_why_it_does_not_open(tmp_path, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    path = write(tmp_path / "a.rrd", None)
    with pytest.raises(MclError, match="there is no screen here"):
        viewer.show(path)
    with pytest.raises(MclError, match="there is no screen here"):
        viewer.open_empty()


@needs_vulkan
def test_runs_appear_in_a_viewer_elsewhere(tmp_path, monkeypatch):
    from rerun.experimental import ViewerClient

    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("CI", "1")
    monkeypatch.setenv("HOME", str(tmp_path))
    port = free_port()
    with ViewerClient.spawn(headless=True, port=port, hide_welcome_screen=True) as opened:
        address = f"rerun+http://127.0.0.1:{port}/proxy"
        first = write(tmp_path / "a.rrd", address)
        second = write(tmp_path / "b.rrd", None)
        done = CliRunner().invoke(app, ["view", str(first), str(second), "--connect", address])
        assert done.exit_code == 0
        until = time.monotonic() + PATIENCE
        while len(opened.get_state().recordings) < 2 and time.monotonic() < until:
            time.sleep(0.2)
        time.sleep(1.0)
        state = opened.get_state()
        assert len(state.recordings) == 2  # the one that was watched, and the two side by side
        assert all({"scan", "t"} <= {line.name for line in one.timelines} for one in state.recordings)
        assert {"A: synthetic, seed 0", "B: synthetic, seed 0", "On one map"} <= {view.name for view in state.views}
        while any(view.reports for view in opened.get_state().views) and time.monotonic() < until:
            time.sleep(0.2)
        assert [view.reports for view in opened.get_state().views if view.reports] == []
