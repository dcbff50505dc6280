"""One recording that shows several runs on the same time line: each on its own map, and all of them on one."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import ascii_uppercase
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.recording import entities, palette
from pipeline.recording.blueprint import (
    ASPECT,
    Area,
    blueprint,
    curves,
    framed,
    known_area,
    looking_down,
    map_view,
    so_far,
)
from pipeline.recording.columns import curve_stops, segments, timelines, transforms
from pipeline.recording.gaps import longest_interval
from pipeline.recording.rrd_file import RrdFile
from pipeline.recording.scales import Scales
from pipeline.recording.scenes import CURVES, Scenes
from pipeline.recording.streams import opened, sending
from pipeline.recording.witness_views import recorded_tab

MOST = len(ascii_uppercase)
NAMED = 2
"""Parameters in a name."""
Apart = tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]
"""How far one is from the first run: scans (n,), times (n,) s, distances (n,) m."""
ALL = "/all"
DISTANCE = "/apart/distance"
_DISTANCES = "Distance between the estimates, m"
_ESTIMATE_HEIGHT = 0.1


@dataclass(frozen=True)
class Shown:
    """A run to be shown: what it is called, its chunks, and what they draw."""

    name: str
    file: RrdFile
    scenes: Scenes


@dataclass(frozen=True)
class Way:
    """Where another filter has the robot, at scans (n,) of the first run, times (n,) s: poses (n, 3), map frame."""

    name: str
    scans: NDArray[np.int64]
    times: NDArray[np.float64]
    poses: NDArray[np.float64]


def letters(count: int) -> list[str]:
    """What so many runs are called: A, B, ..."""
    return list(ascii_uppercase[:count])


def called(runs: Sequence[Shown | Way]) -> list[str]:
    """What each is called in the picture: letter and name; where names are alike also parameters that differ."""
    names = [f"{letter}: {run.name}" for letter, run in zip(letters(len(runs)), runs, strict=True)]
    if len({run.name for run in runs}) == len(runs):
        return names
    configs = [_config(run.file) if isinstance(run, Shown) else {} for run in runs]
    keys = dict.fromkeys(key for config in configs for key in config)
    differing = [key for key in keys if any(config.get(key) != configs[0].get(key) for config in configs)]
    told = [", ".join(f"{key} {config.get(key, '-')}" for key in differing[:NAMED]) for config in configs]
    return [f"{name}, {parameters}" if parameters else name for name, parameters in zip(names, told, strict=True)]


def write_side_by_side(path: Path, runs: Sequence[Shown | Way], *, apart: Mapping[str, Apart]) -> None:
    """Write the recording, with curves of how far others are ``apart`` from the first run, by their letters.

    Raises MclError if there are too many runs, or if the file exists already.
    """
    if path.exists():
        raise MclError("this recording exists already and is never overwritten", path=path)
    _fill(rr.FileSink(path), runs, apart)


def send_side_by_side(address: str, runs: Sequence[Shown | Way], *, apart: Mapping[str, Apart]) -> None:
    """Show the runs in the viewer at ``address``. Raises MclError if there are too many, or if it takes nothing."""
    sending(address, lambda sink: _fill(sink, runs, apart))


def send_run(address: str, run: Shown) -> None:
    """Show one run as its own recording does in the viewer at ``address``. Raises MclError if it takes nothing."""
    sending(address, lambda sink: _fill_with_one(sink, run))


def write_run(path: Path, run: Shown, *, tab: int = 0) -> None:
    """Write a run's recording anew, with that tab in front: a whole file of what could be read of a damaged one."""
    _fill_with_one(rr.FileSink(path), run, tab)


def _fill_with_one(sink: Any, run: Shown, tab: int = 0) -> None:
    layout = blueprint(
        run.scenes.grid,
        scales=Scales.of_chunks(run.file.chunks),
        truth=bool(np.isfinite(run.scenes.truth).any()),
        tab=tab,
        motion=recorded_tab(run.file),
    )
    with opened(sink, run.file.application_id, run.file.recording_id, layout) as stream:
        stream.send_chunks(run.file.chunks)


def _fill(sink: Any, runs: Sequence[Shown | Way], apart: Mapping[str, Apart]) -> None:
    if len(runs) > MOST:
        raise MclError(f"at most {MOST} runs fit into one picture, {len(runs)} were given")
    shown = [run for run in runs if isinstance(run, Shown)]
    ids = "-".join(run.file.recording_id for run in shown)
    one_map = all(same_map(run.scenes, shown[0].scenes) for run in shown)
    layout = _blueprint(runs, one_map, list(apart))
    with opened(sink, entities.SEVERAL_ID, f"side-by-side-{ids}"[:200], layout) as stream:
        for name, letter, run, colour in zip(called(runs), letters(len(runs)), runs, _colours(len(runs)), strict=True):
            if isinstance(run, Shown):
                stream.send_chunks(_below(f"/{letter}", run.file))
                for entity in CURVES.values():
                    lines = rr.SeriesLines(colors=colour, names=name, widths=1.5)
                    stream.log(f"/{letter}{entity}", lines, static=True)
                if one_map:
                    scenes = run.scenes
                    index = timelines(scenes.scans, scenes.times)
                    _log_overlay(stream, letter, index, scenes.estimates, scenes.joined, colour)
            elif one_map:
                index = timelines(run.scans, run.times)
                _log_overlay(stream, letter, index, run.poses, np.ones(len(run.poses), np.bool_), colour)
        colours = dict(zip(letters(len(runs)), _colours(len(runs)), strict=True))
        for letter, (scans, times, distances) in apart.items():
            entity, colour = f"{DISTANCE}/{letter}", palette.ESTIMATE if len(apart) == 1 else colours[letter]
            stream.log(entity, rr.SeriesLines(colors=colour, names=f"A to {letter}, m", widths=1.5), static=True)
            stream.send_columns(entity, timelines(scans, times), rr.Scalars.columns(scalars=distances))
            silent = times[:-1][np.diff(times) > longest_interval(times)]
            if len(silent):
                stream.send_columns(*curve_stops(entity, silent))


def _below(place: str, file: RrdFile) -> list[object]:
    """The chunks of a run, moved; but for its curves' styles, which give every run the same colours."""
    return [
        chunk.with_entity_path(place + chunk.entity_path)
        for chunk in file.chunks
        if not chunk.entity_path.startswith(("/__", entities.TIMINGS))
        and not (chunk.is_static and chunk.entity_path in CURVES.values())
    ]


def _config(file: RrdFile) -> dict[str, Any]:
    """A run's parameters, as its recording has them."""
    for chunk in file.chunks:
        if chunk.entity_path == f"/__properties/{entities.PROPERTY_RUN}":
            found: dict[str, Any] = json.loads(chunk.to_record_batch()["config"][0].as_py()[0])
            return found
    return {}


def same_map(a: Scenes, b: Scenes) -> bool:
    """Whether both draw the same map at the same place."""
    return (
        a.shades.shape == b.shades.shape
        and bool((a.shades == b.shades).all())
        and (a.grid.origin, a.grid.resolution) == (b.grid.origin, b.grid.resolution)
    )


def _log_overlay(
    stream: rr.RecordingStream,
    letter: str,
    index: list[Any],
    poses: NDArray[np.float64],
    joined: NDArray[np.bool_],
    colour: palette.Colour,
) -> None:
    turn = np.linspace(0.0, 2 * np.pi, 33)
    ring = 0.3 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=-1)
    thick = rr.Radius.ui_points(1.5)
    stream.send_columns(f"{ALL}/{letter}/path", index, segments(poses, z=0.03, joined=joined))
    stream.log(f"{ALL}/{letter}/path", rr.LineStrips3D.from_fields(radii=thick, colors=colour), static=True)
    stream.send_columns(f"{ALL}/{letter}/robot", index, transforms(poses, z=_ESTIMATE_HEIGHT))
    stream.log(f"{ALL}/{letter}/robot/body", rr.LineStrips3D([ring], radii=thick, colors=colour), static=True)
    arrow = rr.Arrows3D(vectors=[[1.0, 0.0, 0.0]], radii=thick, colors=colour, labels=[letter], show_labels=True)
    stream.log(f"{ALL}/{letter}/robot/heading", arrow, static=True)


def _blueprint(runs: Sequence[Shown | Way], one_map: bool, apart: Sequence[str]) -> rrb.Blueprint:
    everyone, names = letters(len(runs)), called(runs)
    own = [
        (letter, name, run) for letter, name, run in zip(everyone, names, runs, strict=True) if isinstance(run, Shown)
    ]
    below = [letter for letter, _, _ in own]
    areas = [known_area(run.scenes.grid) for _, _, run in own]
    columns, aspect = _columns(areas)
    maps: list[rrb.View | rrb.Container] = [
        map_view(area, below=f"/{letter}", name=name, aspect=aspect)
        for (letter, name, _), area in zip(own, areas, strict=True)
    ]
    tabs: list[rrb.View | rrb.Container] = [rrb.Grid(*maps, grid_columns=columns, name="Side by side")]
    if one_map:
        tabs.append(
            rrb.Spatial3DView(
                origin="/",
                name="On one map",
                contents=[f"{ALL}/**", f"/{below[0]}{entities.MAP}", f"/{below[0]}{entities.TRUTH_PATH}"],
                eye_controls=looking_down(areas[0]),
                line_grid=False,
                background=palette.UNKNOWN,
                overrides={f"{ALL}/{letter}/path": so_far() for letter in everyone},
            )
        )
    beside = [
        *([curves(_DISTANCES, *(f"{DISTANCE}/{letter}" for letter in apart), legend=True)] if apart else []),
        curves("Share of the beams explained", *(f"/{letter}{entities.EXPLAINED}" for letter in below), legend=True),
        curves("Spread of the particles, m", *(f"/{letter}{entities.SPREAD}" for letter in below), legend=True),
        curves("Effective sample size", *(f"/{letter}{entities.ESS}" for letter in below), legend=True),
    ]
    events = rrb.TextLogView(
        name="Events",
        contents=[f"/{letter}{entities.EVENTS}" for letter in below],
        columns=rrb.TextLogColumns(
            timeline_columns=[entities.TIME], text_log_columns=["entitypath", "loglevel", "body"]
        ),
    )
    main = rrb.Vertical(rrb.Tabs(*tabs, active_tab=0), events, row_shares=[5, 1])
    return framed(rrb.Horizontal(main, rrb.Vertical(*beside), column_shares=[5, 2]))


def _columns(areas: Sequence[Area]) -> tuple[int, float]:
    """In how many columns the maps are seen largest, and the width over height of each view then."""
    shapes = [(columns, ASPECT * -(-len(areas) // columns) / columns) for columns in range(1, len(areas) + 1)]
    return min(shapes, key=lambda shape: max(area.eye_height(shape[1]) for area in areas))


def _colours(count: int) -> list[palette.Colour]:
    return [palette.RUNS[k % len(palette.RUNS)] for k in range(count)]
