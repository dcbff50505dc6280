"""Memories from the command line: begun with, added to in passes, and made a map of."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import buildings
import numpy as np
import pytest
from commands import Command

from pipeline.maps.map_server import load_map
from pipeline.simulate import simulate_log
from pipeline.simulate.files import write_mcap
from pipeline.world.seen import MEMORY, NEW, Seen, read_seen

QUICK = ("--particles", 400, "--set", "min_particles=400", "--set", "recovery=none", "--no-record")
BOX = {"at": [5.0, 4.2], "size": [0.6, 0.6]}
"""What the room has and its map has not."""


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A drive round a box that the map lacks, and the same room with another map."""
    folder, room = tmp_path_factory.mktemp("logs"), buildings.room()
    furniture = [*room.model_dump(exclude_none=True)["furniture"], BOX]
    for name, mapped in (("room", False), ("other", True)):
        description = buildings.room(name=name, furniture=[*furniture[:-1], BOX | {"mapped": mapped}])
        write_mcap(simulate_log(description, 2), folder / f"{name}.mcap")
    return folder / "room.mcap", folder / "other.mcap"


@pytest.fixture(scope="module")
def start(logs: tuple[Path, Path]) -> tuple[str, str]:
    x, y, yaw = simulate_log(buildings.room(), 2).ground_truth.poses[0].tolist()
    return "--pose", f"{x},{y},{yaw}"


@pytest.fixture(scope="module")
def first(
    typed_here: Command, logs: tuple[Path, Path], start: tuple[str, str], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    run = tmp_path_factory.mktemp("first") / "run"
    typed_here("localize", logs[0], *start, *QUICK, "--require-found", "-o", run)
    return run


def box_share(hits: np.ndarray, margin: int) -> float:
    """Share of the cells round the box's border that are walls."""
    (x, y), half = BOX["at"], 0.3  # type: ignore[misc]
    left, right, low, high = (round(v / 0.05) + margin for v in (x - half, x + half, y - half, y + half))
    border = np.zeros(hits.shape, np.bool_)
    border[low - 1 : high + 1, left - 1 : right + 1] = True
    border[low + 2 : high - 2, left + 2 : right - 2] = False
    return float((hits[border]).mean())


def of_another_log(run: Path, folder: Path) -> Path:
    """A folder with the same memory, as if it were of another log."""
    other = folder / "another"
    other.mkdir()
    dataclasses.replace(read_seen(run / MEMORY), logs=("another",)).write(other / MEMORY)
    return other


def counted(seen: Seen) -> float:
    """All in all; of a cell at most so many scans that new ones outweigh them."""
    return float((seen.hits + seen.passes).sum())


def test_a_run_leaves_what_it_has_seen(first: Path) -> None:
    seen = read_seen(first / MEMORY)
    assert (seen.changed == NEW).sum() > 5
    assert box_share(seen.changed == NEW, seen.margin) > 0.1


def test_a_run_begins_with_what_earlier_ones_saw_and_adds_to_it(
    typed_here: Command, logs: tuple[Path, Path], start: tuple[str, str], first: Path, tmp_path: Path
) -> None:
    with_it, passes, both = tmp_path / "with", tmp_path / "passes", tmp_path / "both"
    typed_here("localize", logs[0], *start, *QUICK, "--memory", first, "-o", with_it)
    typed_here("localize", logs[0], *start, *QUICK, "--passes", 2, "-o", passes)
    alone = counted(read_seen(first / MEMORY))
    # Of a log that was seen before, its scans count once.
    for run in (with_it, passes):
        assert counted(read_seen(run / MEMORY)) == pytest.approx(alone, rel=0.2)
    # Of another log, both count.
    done = typed_here("localize", logs[0], *start, *QUICK, "--memory", of_another_log(first, tmp_path), "-o", both)
    assert counted(read_seen(both / MEMORY)) > 1.5 * alone
    assert "began with" in done.stderr
    assert json.loads((both / "run.json").read_text())["memory"]["began_with_logs"] == ["another"]


def test_who_asks_for_a_robot_that_is_found_is_told_if_it_is_not(
    typed_here: Command, logs: tuple[Path, Path], tmp_path: Path
) -> None:
    """The run is there all the same; without asking, it is a run like others."""
    elsewhere = ("--pose", "8.5,1.5,1.0", *QUICK)
    run = tmp_path / "lost"
    done = typed_here("localize", logs[0], *elsewhere, "--require-found", "-o", run, code=3)
    assert done.stdout.strip() == str(run)
    figures = json.loads((run / "run.json").read_text())["figures"]
    assert figures["verdict"]["at_end"] in ("lost", "ambiguous")
    told = json.loads(typed_here("localize", logs[0], *elsewhere, "--json", "-o", tmp_path / "again").stdout)
    assert told["figures"]["verdict"] == figures["verdict"]


def test_a_map_is_made_of_one_run_or_several(typed_here: Command, first: Path, tmp_path: Path) -> None:
    out = tmp_path / "new.yaml"
    done = typed_here("export", first, "-o", out)
    assert done.stdout == f"{out}\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new.pgm", "new.yaml"]
    renewed, found = read_seen(first / MEMORY).renewed(), load_map(out)
    np.testing.assert_allclose(found.origin, renewed.origin, atol=1e-6)
    assert found.resolution == pytest.approx(renewed.resolution)
    np.testing.assert_array_equal(found.occupied(0.65), renewed.occupied(0.65))
    np.testing.assert_array_equal(found.free(0.25), renewed.free(0.25))
    assert "--force" in typed_here("export", first, "-o", out, code=1).stderr
    assert "the same log" in typed_here("export", first, first, "-o", out, "--force", code=1).stderr
    other = of_another_log(first, tmp_path)
    typed_here("export", first, other, "-o", out, "--force")
    together = read_seen(first / MEMORY).merged(read_seen(other / MEMORY))
    np.testing.assert_array_equal(load_map(out).occupied(0.65), together.renewed().occupied(0.65))


def test_the_renewed_map_is_one_to_localize_on(
    typed_here: Command, logs: tuple[Path, Path], start: tuple[str, str], first: Path, tmp_path: Path
) -> None:
    typed_here("export", first, "-o", tmp_path / "new.yaml")
    run = tmp_path / "run"
    typed_here("localize", logs[0], "--map", tmp_path / "new.yaml", *start, *QUICK, "--require-found", "-o", run)
    explained = [json.loads((r / "run.json").read_text())["figures"]["explained"] for r in (first, run)]
    assert explained[1] > explained[0]  # the box is on it


def test_what_is_no_memory_to_begin_with_is_said_in_one_line_and_leaves_nothing(
    typed_here: Command, logs: tuple[Path, Path], first: Path, tmp_path: Path
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / MEMORY).write_bytes((first / MEMORY).read_bytes()[:300])
    refused = {
        (logs[0], tmp_path / "empty"): "no memory of a run",
        (logs[0], tmp_path / "none"): "no such folder",
        (logs[0], logs[1]): "no run",
        (logs[0], tmp_path / "damaged"): "no memory of a run",
        (logs[1], first): "another map",
    }
    for (log, memory), said in refused.items():
        done = typed_here("localize", log, *QUICK, "--memory", memory, "-o", tmp_path / "run", code=1)
        (line,) = [line for line in done.stderr.splitlines() if line.startswith("error")]
        assert said in line
        assert not (tmp_path / "run").exists()
    assert "no memory of a run" in typed_here("export", tmp_path / "empty", "-o", tmp_path / "a.yaml", code=1).stderr
    assert "made of one run" in typed_here("export", first, first, "-o", tmp_path / "a.csv", code=1).stderr
    assert not list(tmp_path.glob("a.*"))
