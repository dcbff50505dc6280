"""Maps made wrong on purpose: as much as was asked, only where the robot looks, the same for the same seed."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import distance_transform_edt

from pipeline.config import Config, load_config
from pipeline.errors import MclError
from pipeline.evaluate import (
    CHANGE_COLUMNS,
    Change,
    Comparison,
    change_table,
    compare,
    evaluate,
    parse_changes,
    perturb,
    plot_changes,
    variants,
    with_changes,
)
from pipeline.evaluate.changes import KINDS
from pipeline.evaluate.metrics import interpolate
from pipeline.evaluate.seen_walls import drive
from pipeline.logs.messages import Laser, Log, Trajectory
from pipeline.maps.occupancy_grid import OccupancyGrid

CONFIG = Config()
LASER = Laser((0.1, 0.0, 0.0), -np.pi / 2, np.pi / 180, 181, 0.0, 20.0)
SECOND = 1_000_000_000


def two_rooms(origin: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> OccupancyGrid:
    """A room of 12 m by 8 m with a pillar and a door of 1 m in a thin wall, and beside it one that nobody can see."""
    cells = np.full((200, 400), np.nan, np.float32)
    cells[20:180, 20:380] = 0.02
    walls = [
        ((20, 180), (20, 22)),
        ((20, 180), (140, 142)),
        ((20, 180), (258, 262)),
        ((20, 180), (378, 380)),
        ((20, 22), (20, 380)),
        ((178, 180), (20, 380)),
        ((60, 66), (80, 86)),
    ]
    for rows, cols in walls:
        cells[slice(*rows), slice(*cols)] = 1.0
    cells[90:110, 140:142] = 0.02
    return OccupancyGrid(cells, 0.05, origin)


def way(grid: OccupancyGrid) -> np.ndarray:
    """Through the door and back in the first room, in the map frame."""
    x = np.concatenate([np.linspace(2.5, 11, 120), np.linspace(11, 2.5, 120)])
    yaw = np.concatenate([np.zeros(120), np.full(120, np.pi)])
    return grid.to_map(np.column_stack([x, np.full(240, 5.0), yaw]))


def room_log(**changes) -> Log:
    grid = two_rooms()
    stamps = np.arange(240, dtype=np.int64) * (SECOND // 4)
    log = Log(
        "rooms", Path("rooms.mcap"), "0" * 64, LASER, stamps, way(grid), np.ones((240, 181), np.float32),
        grid=grid, ground_truth=Trajectory(stamps, way(grid)),
    )  # fmt: skip
    return replace(log, **changes)


def told(poses: np.ndarray):
    n = len(poses)
    return SimpleNamespace(
        poses=poses, hindsight=None, weights=np.ones(n), probability=np.ones(n), explained=np.ones(n),
        covariances=np.tile(np.eye(3), (n, 1, 1)), events=(), seconds={},
    )  # fmt: skip


def worse_with_the_map(log: Log, config: Config, *, seed: int, threads: int):
    """A robot whose error is the share of occupied cells that are others than in the true map, m."""
    assert log.grid is not None
    wrong = np.mean(log.grid.occupied(0.97)[two_rooms().occupied(0.97)] == 0)
    return told(log.odometry + np.array([wrong, 0.0, 0.0]))


# --- what is seen


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (-30.0, 12.5, 0.7)])
def test_only_walls_that_a_beam_can_reach_are_seen(origin):
    grid = two_rooms(origin)
    seen = drive(way(grid), LASER, grid, 20.0).seen(grid.occupied(0.97))
    rows, cols = np.nonzero(seen)
    assert cols.max() == 258  # the face of the wall between the rooms, not its back
    assert (cols == 21).sum() > 120  # the wall that it drives towards at the end, but for what the inner wall hides
    assert rows.min() == 21
    assert rows.max() == 178
    assert not seen[20].any()


def test_no_farther_than_the_laser_reaches():
    grid = two_rooms()
    seen = drive(way(grid), LASER, grid, 2.0).seen(grid.occupied(0.97))
    at = np.argwhere(seen) * 0.05
    # The laser drives along y = 5 from x = 2.4 to 11.1.
    away = np.hypot(np.maximum(np.maximum(2.4 - at[:, 1], at[:, 1] - 11.1), 0.0), at[:, 0] - 5.0)
    assert len(at)
    assert away.max() < 2.1


# --- how much is changed


@pytest.mark.parametrize("kind", ["mixed", *KINDS])
@pytest.mark.parametrize("share", [0.05, 0.2])
def test_as_much_is_changed_as_was_asked(office, kind, share):
    truth = interpolate(office.ground_truth, office.stamps)
    made = perturb(office.grid, truth, office.laser, CONFIG, Change(kind, share), 1)
    assert made.changed == pytest.approx(share, abs=0.02)
    # The same, counted in another way: seen walls that are no more, and walls seen that were none.
    looked = drive(truth, office.laser, office.grid, 81.0)
    before, after = office.grid.occupied(0.97), made.grid.occupied(0.97)
    seen = looked.seen(before)
    gone, new = np.sum(seen & ~after), np.sum(looked.seen(after) & ~before)
    if kind in ("erased", "unknown"):
        assert gone / seen.sum() == pytest.approx(made.changed)
        assert not new
    elif kind in ("boxes", "shut"):
        assert new / seen.sum() == pytest.approx(made.changed)
        assert not gone
    elif kind == "doors":
        assert (gone + new) / seen.sum() == pytest.approx(made.changed)
    elif kind == "moved":  # where a wall moves over another one's place, a cell may be wall before and after
        assert 0.7 * made.changed < gone / seen.sum() <= made.changed


def test_only_a_door_of_shut_is_in_the_way(office):
    truth = interpolate(office.ground_truth, office.stamps)
    cols, rows = np.floor(office.grid.to_grid(truth)[:, :2] / office.grid.resolution).astype(int).T
    off = np.ones((office.grid.height, office.grid.width), bool)
    off[rows, cols] = False
    close = distance_transform_edt(off) * office.grid.resolution <= 0.3
    for kind in KINDS:
        made = perturb(office.grid, truth, office.laser, CONFIG, Change(kind, 0.2), 3)
        new = made.grid.occupied(0.97) & ~office.grid.occupied(0.97)
        assert (new & close).any() == (kind == "shut"), kind


def test_a_place_that_the_robot_never_sees_is_no_part_of_it():
    """Its walls may go with a patch that reaches over to it, but they count for nothing."""
    grid = two_rooms()
    made = perturb(grid, way(grid), LASER, CONFIG, Change("erased", 0.3), 0)
    looked = drive(way(grid), LASER, grid, 20.0)
    seen = looked.seen(grid.occupied(0.97))
    assert np.sum(seen & ~made.grid.occupied(0.97)) / np.sum(seen) == pytest.approx(made.changed)
    assert (made.grid.occupancy[100:170, 370:380] == grid.occupancy[100:170, 370:380])[:, 8:].all()


def test_what_finds_no_place_is_not_told_as_changed():
    """The only gaps that the robot drives through are a door and the width of the room, which is too wide."""
    grid = two_rooms()
    made = perturb(grid, way(grid), LASER, CONFIG, Change("shut", 0.5), 0)
    assert 0.0 < made.changed < 0.2
    assert made.grid.occupied(0.97)[90:110, 140:142].all(axis=0).any()


def test_unknown_and_erased_differ_in_what_is_left():
    grid = two_rooms()
    erased, unknown = (
        perturb(grid, way(grid), LASER, CONFIG, Change(kind, 0.1), 0).grid.occupancy for kind in ("erased", "unknown")
    )
    assert not np.isnan(erased[~np.isnan(grid.occupancy)]).any()
    assert (erased[~np.isnan(erased) & (erased != grid.occupancy)] == np.float32(0.02)).all()
    assert np.isnan(unknown[~np.isnan(grid.occupancy)]).sum() > 100


def test_a_seed_draws_the_same_and_another_one_others():
    grid = two_rooms()
    one, again, other = (
        perturb(grid, way(grid), LASER, CONFIG, Change("mixed", 0.2), seed).grid.sha256 for seed in (4, 4, 5)
    )
    assert one == again != other


def test_more_of_a_kind_goes_on_from_less():
    grid = two_rooms()
    less, more = (
        perturb(grid, way(grid), LASER, CONFIG, Change("unknown", share), 2).grid.occupancy for share in (0.1, 0.3)
    )
    assert np.isnan(more[np.isnan(less)]).mean() > 0.95


def test_a_reference_that_sees_no_wall_is_an_error():
    grid = two_rooms()
    far = way(grid) + np.array([500.0, 0.0, 0.0])
    with pytest.raises(MclError, match="no beam from the reference ends on a wall of this map"):
        perturb(grid, far, LASER, CONFIG, Change("boxes", 0.1), 0)


# --- asking for it


def test_what_is_asked_for():
    assert parse_changes("0.1,0.2") == (Change("mixed", 0.1), Change("mixed", 0.2))
    assert parse_changes("boxes:0.4") == (Change("boxes", 0.4),)
    assert parse_changes("boxes:0,0.1") == (Change("unchanged", 0.0), Change("boxes", 0.1))
    for text in ("boxes:", "boxes:1.5", "-0.1", "nan", "0.1,,0.2", "boxes:0.1:0.2", ""):
        with pytest.raises(MclError):
            parse_changes(text)
    with pytest.raises(MclError, match=r"no kind of change 'walls' \(there are mixed, doors, shut"):
        parse_changes("walls:0.1")


# --- in an evaluation


def test_the_filter_gets_the_wrong_map_and_all_else_as_it_was():
    seen = []

    def runner(log: Log, config: Config, *, seed: int, threads: int):
        seen.append((log, os.environ["MCL_CACHE_DIR"]))
        return told(log.odometry)

    log, cache = room_log(), os.environ["MCL_CACHE_DIR"]
    done = evaluate([log], [None], CONFIG, runs=2, jobs=1, change=Change("boxes", 0.1), runner=runner)
    assert len({given.grid.sha256 for given, _ in seen} | {log.grid.sha256}) == 3  # another one for every seed
    for given, folder in seen:
        assert replace(given, grid=log.grid) == log
        assert folder != cache  # a map that nobody asks for again leaves no table of ranges
        assert not Path(folder).exists()
    assert os.environ["MCL_CACHE_DIR"] == cache
    (only,) = done.logs
    assert only.grid is log.grid
    assert [run.map_changed for run in only.runs] == [pytest.approx(0.1, abs=0.02)] * 2
    plain = json.loads(json.dumps(done.to_dict()))
    assert plain["change"] == {"kind": "boxes", "share": 0.1}
    assert [(run["seed"], run["map_changed"]) for run in plain["logs"]["rooms"]["seeds"]] == [
        (run.seed, run.map_changed) for run in only.runs
    ]
    assert change_table(done)[0][:3] == ("rooms", "boxes", "10")


def test_an_unchanged_map_is_the_map():
    def runner(log: Log, config: Config, *, seed: int, threads: int):
        assert log.grid is grid
        return told(log.odometry)

    log = room_log()
    grid = log.grid
    done = evaluate([log], [None], CONFIG, runs=1, jobs=1, change=Change("unchanged", 0.0), runner=runner)
    assert done.logs[0].runs[0].map_changed == 0.0
    without = evaluate([log], [None], CONFIG, runs=1, jobs=1, runner=runner)
    assert "change" not in json.dumps(without.to_dict())
    assert change_table(without) == []


def test_kinds_and_shares_are_compared_as_parameters_are(tmp_path):
    keys, found = variants(["recovery=search,augmented"], lambda values: load_config(None, values))
    asked = [*parse_changes("0,0.1"), *parse_changes("erased:0,0.3")]
    keys, found = with_changes(keys, found, asked)
    assert keys == ("map", "recovery")
    assert [one.label for one in found][::2] == ["unchanged, search", "mixed:0.1, search", "erased:0.3, search"]
    configs, changes = [one.config for one in found], [one.change for one in found]
    one, two = (
        compare([room_log()], [None], configs, 2, jobs, changes=changes, runner=worse_with_the_map) for jobs in (1, 2)
    )
    for a, b in zip(one, two, strict=True):
        for x, y in zip(a.logs[0].runs, b.logs[0].runs, strict=True):
            np.testing.assert_array_equal(x.poses, y.poses)
            assert x.map_changed == y.map_changed
    comparison = Comparison(keys, found, one)
    errors = {row[1]: float(row[6]) for row in comparison.table()}
    assert errors["unchanged, search"] == 0.0 < errors["mixed:0.1, search"] < errors["erased:0.3, search"]
    rows = comparison.change_table()
    assert {len(row) for row in rows} == {len(CHANGE_COLUMNS)}
    assert [row[1:3] for row in rows] == [("unchanged", "0"), ("mixed", "10"), ("erased", "30")]
    assert comparison.to_dict()["variants"][2]["values"] == {"map": "mixed:0.1", "recovery": "search"}
    plot_changes(comparison, tmp_path / "shares.png")
    with Image.open(tmp_path / "shares.png") as picture:
        assert picture.width > 1000
        assert len(picture.convert("L").getcolors(10**6)) > 20


def test_what_is_wrong_names_the_log():
    log = room_log()
    away = Trajectory(log.stamps, log.odometry + np.array([500.0, 0.0, 0.0]))
    with pytest.raises(MclError, match=r"rooms\.mcap: no beam from the reference"):
        evaluate([log], [away], CONFIG, runs=1, jobs=1, change=Change("mixed", 0.1), runner=worse_with_the_map)
