"""The first thing that a newcomer types."""

from __future__ import annotations

import json
import re
from pathlib import Path

from commands import Command


def test_the_demo_finds_the_robot_again_and_again(mcl: Command, tmp_path: Path) -> None:
    done = mcl("demo", cwd=tmp_path)
    folder = tmp_path / done.stdout.strip()
    assert folder.parent == tmp_path / "recordings" / "office"
    files = {path.name for path in folder.iterdir()} - {"trajectory_hindsight.tum"}
    assert files == {"office.mcap", "run.rrd", "trajectory.tum", "config.yaml", "run.json", "memory.npz"}
    assert re.fullmatch(r"look at it:  \S*rerun recordings/office/.*/run\.rrd", done.stderr.splitlines()[-1])
    assert "times real time" in done.stderr
    truth = json.loads((folder / "run.json").read_text())["truth"]
    assert truth["success"]
    assert truth["position_error"]["median"] < 0.2

    before = (folder / "run.rrd").read_bytes()
    second = tmp_path / mcl("demo", "--threads", 1, cwd=tmp_path).stdout.strip()
    assert second != folder
    assert (folder / "run.rrd").read_bytes() == before
    assert (second / "trajectory.tum").read_bytes() == (folder / "trajectory.tum").read_bytes()
