"""The tab that shows what wheels and laser say of the way, and whom the belief follows."""

from __future__ import annotations

import numpy as np
import rerun.blueprint as rrb
from numpy.typing import NDArray

from pipeline.logs.messages import Log
from pipeline.motion.faults import without_leaps
from pipeline.recording import entities, palette
from pipeline.recording.blueprint import FIELD_OF_VIEW, Area, curves, known_area, looking_down, so_far
from pipeline.recording.rrd_file import RrdFile

MARGIN = 3.0  # metres around a path
PATHS_ASPECT = 1.0
AROUND = 20.0  # seconds of curves to either side of the cursor
CLOSE = 4.5  # metres that are seen to either side of the robot


def ground(log: Log) -> Area:
    """Where the paths lie in the odometry's frame, as far as it is known before the run."""
    if log.wheels:
        return around(without_leaps(log.times, log.odometry)[:, :2])
    assert log.grid is not None
    width, height = known_area(log.grid).size
    return Area((0.0, 0.0), (2.0 * width, 2.0 * height))


def recorded_tab(file: RrdFile) -> rrb.Container | None:
    """The tab of a run that was recorded, which lies where its paths do; None if it has none."""
    found = [
        chunk.to_record_batch()["LineStrips3D:strips"].flatten().flatten().flatten().to_numpy(zero_copy_only=False)
        for chunk in file.chunks
        if chunk.entity_path == entities.WAYS and not chunk.is_static
    ]
    if not found:
        return None
    wheels = any(chunk.entity_path == entities.APART for chunk in file.chunks)
    return motion_tab(around(np.concatenate(found).reshape(-1, 3)[:, :2]), wheels=wheels)


def around(places: NDArray[np.floating]) -> Area:
    """An area with a margin around places (n, 2)."""
    low, high = places.min(axis=0) - MARGIN, places.max(axis=0) + MARGIN
    centre, size = (low + high) / 2, high - low
    return Area((float(centre[0]), float(centre[1])), (float(size[0]), float(size[1])))


def motion_tab(area: Area, *, wheels: bool = True) -> rrb.Container:
    """The paths by either witness, how the scan fits what was seen before, and curves of what they say."""
    paths = rrb.Spatial3DView(
        origin=entities.MOTION,
        name="The way: " + ("brown by the wheels, " if wheels else "") + "blue by the laser, magenta as believed",
        contents=f"{entities.MOTION}/**",
        eye_controls=looking_down(area, PATHS_ASPECT),
        line_grid=False,
        background=palette.FLOOR,
        overrides={entities.WAYS: so_far()},
    )
    close = rrb.Spatial3DView(
        origin=entities.LASER,
        name="Black: walls seen before. Rays: the scan by the laser."
        + (" Brown: the scan by the wheels" if wheels else ""),
        contents=[
            f"{entities.LASER}/**",
            f"- {entities.EXPECTED}",
            f"{entities.SAID}/**",
            f"{entities.ESTIMATE}/**",
        ],
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=(1.0, 0.0, CLOSE / float(np.tan(FIELD_OF_VIEW / 2))),
            look_target=(1.0, 0.0, 0.0),
            eye_up=(1.0, 0.0, 0.0),
        ),
        line_grid=False,
        background=palette.FLOOR,
    )
    fits = ("Beams that fit: laser (blue), wheels (brown)", "Belief that follows the laser (blue), wheels (brown)")
    alone = ("Beams that fit the walls seen before", "Belief that follows the laser (blue), or neither")
    names = fits if wheels else alone
    told = [
        *(
            [curves("Wheels and laser apart; 1: the limit of chance", entities.APART, most=palette.MOST_APART)]
            if wheels
            else []
        ),
        curves(names[0], entities.FIT, most=1.0, around=AROUND),
        curves(names[1], entities.FOLLOWED, most=1.0, around=AROUND),
    ]
    title = "Wheels and laser" if wheels else "The way by the laser"
    won = rrb.StateTimelineView(origin=entities.WON, name="Whom most of the belief follows")
    below = rrb.Horizontal(*told)
    return rrb.Vertical(rrb.Horizontal(paths, close), won, below, row_shares=[12, 2, 4], name=title)
