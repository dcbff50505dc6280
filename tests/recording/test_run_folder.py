"""Runs do not overwrite each other."""

import json
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from pipeline.config import Config, load_config
from pipeline.errors import MclError
from pipeline.logs.messages import Trajectory
from pipeline.logs.tum import read_tum
from pipeline.recording import run_folder


def test_folders_are_named_after_the_log_and_never_shared(tmp_path):
    with ThreadPoolExecutor(8) as pool:
        folders = list(pool.map(lambda _: run_folder.create("robot data/1", root=tmp_path).path, range(40)))
    assert len(set(folders)) == 40
    assert {folder.parent for folder in folders} == {tmp_path / "robot_data_1"}


@pytest.mark.parametrize("name", ["..", ".", "", "///"])
def test_a_name_cannot_lead_out_of_the_root(tmp_path, name):
    assert run_folder.create(name, root=tmp_path).path.parent.parent == tmp_path


def test_an_output_must_be_new_or_empty(tmp_path):
    assert run_folder.create("log", tmp_path / "a" / "new").path.is_dir()
    empty = tmp_path / "empty"
    empty.mkdir()
    assert run_folder.create("log", empty).path == empty
    (empty / "file").write_text("mine")
    with pytest.raises(MclError, match="not an empty folder"):
        run_folder.create("log", empty)
    with pytest.raises(MclError, match="not an empty folder"):
        run_folder.create("log", empty / "file")
    with pytest.raises(MclError, match="cannot create"):
        run_folder.create("log", empty / "file" / "below")


def test_files_are_complete_and_written_once(tmp_path):
    folder = run_folder.create("log", tmp_path / "run")
    config = Config(max_particles=123)
    trajectory = Trajectory(np.array([1, 2], dtype=np.int64), np.array([[1.0, 2.0, 0.5], [3.0, 4.0, -0.5]]))
    folder.write_config(config)
    folder.write_trajectory(trajectory)
    folder.write_run({"seed": np.int64(3), "error": float("nan"), "poses": np.zeros(2), "path": tmp_path})
    assert load_config(folder.config) == config
    assert read_tum(folder.trajectory).stamps.tolist() == [1, 2]
    assert json.loads(folder.run.read_text()) == {"seed": 3, "error": None, "poses": [0.0, 0.0], "path": str(tmp_path)}
    assert sorted(p.name for p in folder.path.iterdir()) == ["config.yaml", "run.json", "trajectory.tum"]
    for write, value in (
        (folder.write_config, config), (folder.write_trajectory, trajectory), (folder.write_run, {}),
    ):  # fmt: skip
        with pytest.raises(MclError, match="never overwritten"):
            write(value)


def test_a_heading_is_a_comment_whatever_it_says(tmp_path):
    folder, config = run_folder.create("log", tmp_path / "run"), Config(max_particles=123)
    folder.write_config(config, ["log, seed 7", "  mcl 'a\nmax_particles: 1' \x07 \udcff ü", ""])
    assert load_config(folder.config) == config
    assert folder.config.read_text().splitlines()[:3] == [
        "# log, seed 7", "#   mcl 'a?max_particles: 1' ? ? ü", "#"
    ]  # fmt: skip
