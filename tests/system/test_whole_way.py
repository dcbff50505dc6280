"""From a building's description to a scored recording, command by command, each in its own process."""

from __future__ import annotations

import gzip
import json
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from commands import FEW, Command, Journey

from pipeline.config import load_config
from pipeline.logs.tum import read_tum


def test_simulate_ends_with_the_paths_of_what_it_wrote(journey: Journey) -> None:
    assert sorted(map(Path, journey.simulated.splitlines())) == sorted(journey.raw.iterdir())


def test_convert_says_what_it_converted_and_ends_with_the_path(mcl: Command, journey: Journey, tmp_path: Path) -> None:
    out = tmp_path / "a.mcap"
    done = mcl("convert", journey.raw / "office.log.gz", "-o", out)
    assert done.stdout == f"{out}\n"
    for word in ("format", "cmu", "lines", "scans", "duration", "dropped", "size"):
        assert word in done.stderr


def test_a_run_folder_holds_its_files(journey: Journey) -> None:
    files = {path.name for path in journey.run.iterdir()} - {"trajectory_hindsight.tum"}
    assert files == {"run.rrd", "trajectory.tum", "config.yaml", "run.json", "memory.npz"}
    assert load_config(journey.run / "config.yaml").max_particles == 3000
    run = json.loads((journey.run / "run.json").read_text())
    assert run["seed"] == 1
    assert run["log"]["scans"] == len(read_tum(journey.run / "trajectory.tum").stamps)
    assert set(run) == {"log", "seed", "figures", "memory", "truth", "seconds", "speed", "versions"}


def test_the_saved_configuration_says_how_to_repeat_the_run(mcl: Command, journey: Journey, tmp_path: Path) -> None:
    first, again, log = tmp_path / "first run", tmp_path / "again", tmp_path / "bare.mcap"
    mcl("convert", journey.raw / "office.log.gz", "-o", log)
    mcl("localize", log, "--map", journey.raw / "office.dat.gz", *FEW, "--seed", 3, "--threads", 1, "-o", first)
    said = (first / "config.yaml").read_text().splitlines()
    assert said[0] == "# bare, seed 3. The same run again:"
    program, *words = shlex.split(said[1].removeprefix("#"))
    assert program == "mcl"
    assert ("--threads" in words, "--map" in words) == (False, True)
    mcl(*words, "-o", again)
    for name in ("trajectory.tum", "trajectory_hindsight.tum"):
        assert (again / name).read_bytes() == (first / name).read_bytes()


def test_the_trajectory_has_a_row_per_scan_at_the_stamp_of_the_scan(journey: Journey) -> None:
    truth = read_tum(journey.raw / "office_truth.tum")
    assert (read_tum(journey.run / "trajectory.tum").stamps == truth.stamps).all()


def test_inspect_tells_of_the_run(mcl: Command, journey: Journey) -> None:
    said = mcl("inspect", journey.run).stdout
    for word in ("seed", "converged", "events", "started", "/world/particles"):
        assert word in said
    told = json.loads(mcl("inspect", journey.run / "run.rrd", "--json").stdout)
    assert told["seed"] == 1
    assert told["scans"] == told["log_scans"] == json.loads((journey.run / "run.json").read_text())["log"]["scans"]


def test_inspect_says_where_the_robot_was(mcl: Command, journey: Journey) -> None:
    pose = json.loads(mcl("inspect", journey.run, "--at", "12.5", "--json").stdout)
    trajectory = read_tum(journey.run / "trajectory.tum")
    row = int(((trajectory.stamps - trajectory.stamps[0]) / 1e9 <= 12.5).sum()) - 1
    assert pose["scan"] == row
    assert [pose["x"], pose["y"], pose["yaw"]] == pytest.approx(trajectory.poses[row].tolist(), abs=1e-8)
    assert f"scan {row}: x {pose['x']:.3f} m" in mcl("inspect", journey.run, "--at", "12.5").stdout


def test_the_recording_gives_the_trajectory_back_to_the_byte(mcl: Command, journey: Journey, tmp_path: Path) -> None:
    out = tmp_path / "again.tum"
    assert mcl("inspect", journey.run, "--export", out).stdout == f"{out}\n"
    assert out.read_bytes() == (journey.run / "trajectory.tum").read_bytes()


def test_export_gives_the_raw_files_back_to_the_byte(mcl: Command, journey: Journey, tmp_path: Path) -> None:
    done = mcl("export", journey.log, "--raw", tmp_path)
    log, grid = (Path(line).read_bytes() for line in done.stdout.splitlines())
    assert log == gzip.decompress((journey.raw / "office.log.gz").read_bytes())
    assert grid == gzip.decompress((journey.raw / "office.dat.gz").read_bytes())


def test_the_same_seed_gives_the_same_bytes_on_two_threads(mcl: Command, journey: Journey, tmp_path: Path) -> None:
    again, other = tmp_path / "again", tmp_path / "other"
    mcl("localize", journey.log, *FEW, "--seed", 1, "--threads", 2, "-o", again)
    mcl("localize", journey.log, *FEW, "--seed", 2, "--no-record", "-o", other)
    ours = (journey.run / "trajectory.tum").read_bytes()
    assert (again / "trajectory.tum").read_bytes() == ours
    assert (other / "trajectory.tum").read_bytes() != ours
    assert not (other / "run.rrd").exists()
    rerun = shutil.which("rerun", path=str(Path(sys.executable).parent))
    if rerun is None:
        pytest.skip("no rerun program beside this Python")
    compared = subprocess.run(
        [rerun, "rrd", "compare", journey.run / "run.rrd", again / "run.rrd"], capture_output=True, text=True
    )
    assert compared.returncode == 0, compared.stderr


def test_localize_reports_the_run_and_ends_with_its_folder(mcl: Command, journey: Journey, tmp_path: Path) -> None:
    done = mcl("localize", journey.log, *FEW, cwd=tmp_path)
    folder = tmp_path / done.stdout.strip()
    assert folder.parent == tmp_path / "recordings" / "drive"
    assert (folder / "run.rrd").is_file()
    for word in ("seed 0", "scans", "converged", "end pose", "explained", "true:", "wall time", "real time"):
        assert word in done.stderr
    assert done.stderr.splitlines()[-1].endswith(f"rerun {folder.relative_to(tmp_path) / 'run.rrd'}")


def test_a_start_near_the_truth_stays_there_and_json_is_all_that_stdout_gets(
    mcl: Command, journey: Journey, tmp_path: Path
) -> None:
    truth = read_tum(journey.raw / "office_truth.tum")
    x, y, yaw = truth.poses[0].tolist()
    start = (f"--pose={x},{y},{yaw}", "--map", journey.raw / "office.dat.gz")
    done = mcl("localize", journey.log, *FEW, *start, "--no-record", "--json", "-o", tmp_path / "run")
    told = json.loads(done.stdout)
    assert told.pop("folder") == str(tmp_path / "run")
    assert told == json.loads((tmp_path / "run" / "run.json").read_text())
    assert load_config(tmp_path / "run" / "config.yaml").init == "pose"
    found = read_tum(tmp_path / "run" / "trajectory.tum")
    assert found.poses[0, :2] == pytest.approx(truth.poses[0, :2], abs=0.5)


def test_evaluate_scores_seeds_and_draws_them(mcl: Command, journey: Journey, tmp_path: Path) -> None:
    picture = tmp_path / "e.png"
    truth = ("--reference", journey.raw / "office_truth.tum")
    done = mcl("evaluate", journey.short, *truth, *FEW, "--runs", 2, "--jobs", 2, "--plot", picture, "--json")
    told = json.loads(done.stdout)["logs"]["short"]
    assert told["runs"] == len(told["seeds"]) == 2
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert list(tmp_path.iterdir()) == [picture]


@pytest.mark.slow
def test_evaluate_compares_the_sensor_models_in_one_table(mcl: Command, journey: Journey, tmp_path: Path) -> None:
    models = ("beam", "likelihood_field", "likelihood_field_prob")
    pose = ",".join(str(v) for v in read_tum(journey.raw / "office_truth.tum").poses[0].tolist())
    known = (*FEW, "--set", "init=pose", "--set", f"initial_pose=[{pose}]", "--runs", 1, "--jobs", 1)
    vary = ("--vary", f"sensor_model={','.join(models)}")
    picture = tmp_path / "e.png"
    lines = mcl("evaluate", journey.log, *known, *vary, "--plot", picture).stdout.splitlines()
    assert lines[0] == "1 runs per row"
    assert lines[1].split()[:2] == ["log", "sensor_model"]
    assert [line.split()[:2] for line in lines[2:5]] == [["drive", model] for model in models]
    assert lines[5] == "seed by seed against beam"
    assert [line.split()[:2] for line in lines[7:9]] == [["drive", model] for model in models[1:]]
    assert picture.read_bytes().startswith(b"\x89PNG")
    told = json.loads(mcl("evaluate", journey.log, *known, *vary, "--json").stdout)
    assert told["vary"] == ["sensor_model"]
    assert [each["values"] for each in told["variants"]] == [{"sensor_model": model} for model in models]
    for each in told["variants"]:
        assert each["config"]["sensor_model"] == each["values"]["sensor_model"]
        assert [run["seed"] for run in each["logs"]["drive"]["seeds"]] == [0]
        assert each["logs"]["drive"]["successes"] == 1
    alone = json.loads(mcl("evaluate", journey.log, *known, "--json").stdout)
    one, same = (each["logs"]["drive"]["position_error"] for each in (alone, told["variants"][0]))
    assert one == same


@pytest.mark.slow
def test_a_limit_is_asked_of_every_variant(mcl: Command, journey: Journey) -> None:
    lost = ("--set", "init=pose", *FEW, "--runs", 1, "--jobs", 1, "--require-success", "0.95")
    done = mcl("evaluate", journey.log, *lost, "--vary", "initial_pose=[1, 1, 0],[2, 1, 0]", code=3)
    assert done.stderr.splitlines() == [
        f"error: drive, {pose}: 0 of 1 runs succeeded, 95 % required" for pose in ("[1, 1, 0]", "[2, 1, 0]")
    ]


def test_a_result_for_ros_is_written_beside_the_folder(mcl: Command, journey: Journey, tmp_path: Path) -> None:
    out, folder = tmp_path / "out.mcap", tmp_path / "run"
    done = mcl("localize", journey.log, *FEW, "--no-record", "--output-mcap", out, "-o", folder)
    assert done.stdout.splitlines() == [str(out), str(folder)]
    assert "output-mcap" not in (folder / "config.yaml").read_text()  # it is no part of the run
    again = mcl("localize", journey.log, *FEW, "--output-mcap", out, "-o", tmp_path / "other", code=1)
    assert again.stderr == f"error: {out}: this file exists already (results are never overwritten)\n"
    assert not (tmp_path / "other").exists()
    third = mcl("localize", out, *FEW, "--no-record", "-o", tmp_path / "third", "--json")  # a log like any other
    assert json.loads(third.stdout)["folder"] == str(tmp_path / "third")
    assert (tmp_path / "third" / "trajectory.tum").read_bytes() == (folder / "trajectory.tum").read_bytes()


def test_a_requested_limit_that_fails_is_exit_code_3(mcl: Command, journey: Journey) -> None:
    lost = ("--set", "init=pose", "--set", "initial_pose=[1, 1, 0]", *FEW)
    done = mcl("evaluate", journey.short, *lost, "--runs", 1, "--require-success", "0.95", code=3)
    assert "short" in done.stdout
    assert done.stderr == "error: short: 0 of 1 runs succeeded, 95 % required\n"
    assert mcl("evaluate", journey.short, *lost, "--runs", 1, "--require-success", "0").stderr == ""
