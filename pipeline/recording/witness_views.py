"""The tab that shows what wheels and laser say of the way, and whom the belief follows."""

from __future__ import annotations

import numpy as np
import rerun.blueprint as rrb
from numpy.typing import NDArray

from pipeline.logs.messages import Log
from pipeline.recording import entities, palette
from pipeline.recording.blueprint import Area, curves, known_area, looking_down, so_far
from pipeline.recording.rrd_file import RrdFile
from pipeline.recording.witnesses import MOST

MARGIN = 3.0  # metres around a path
PATHS_ASPECT = 1.0
AROUND = 20.0  # seconds of curves to either side of the cursor
CLOSE = 4.5  # metres that are seen to either side of the robot


def ground(log: Log) -> Area:
    """Where the paths lie in the odometry's frame, as far as it is known before the run."""
    if log.wheels:
        return around(log.odometry[:, :2])
    assert log.grid is not None
    width, height = known_area(log.grid).size
    return Area((0.0, 0.0), (2.0 * width, 2.0 * height))


def recorded_ground(file: RrdFile) -> Area | None:
    """The same of a recording, from the paths in it; None if it has none."""
    found = [
        chunk.to_record_batch()["LineStrips3D:strips"].flatten().flatten().flatten().to_numpy(zero_copy_only=False)
        for chunk in file.chunks
        if chunk.entity_path == entities.WAYS and not chunk.is_static
    ]
    return around(np.concatenate(found).reshape(-1, 3)[:, :2]) if found else None


def around(places: NDArray[np.floating]) -> Area:
    """An area with a margin around places (n, 2)."""
    low, high = places.min(axis=0) - MARGIN, places.max(axis=0) + MARGIN
    centre, size = (low + high) / 2, high - low
    return Area((float(centre[0]), float(centre[1])), (float(size[0]), float(size[1])))


def motion_tab(area: Area) -> rrb.Container:
    """The paths by either witness, how the scan fits what was seen before, and curves of what they say."""
    paths = rrb.Spatial3DView(
        origin=entities.MOTION,
        name="The way: brown by the wheels, blue by the laser, magenta as believed",
        contents=f"{entities.MOTION}/**",
        eye_controls=looking_down(area, PATHS_ASPECT),
        line_grid=False,
        background=palette.FLOOR,
        overrides={entities.WAYS: so_far()},
    )
    close = rrb.Spatial3DView(
        origin=entities.LASER,
        name="Black: walls seen before. Rays: the scan by the laser. Brown: the scan by the wheels",
        contents=[
            f"{entities.LASER}/**",
            f"- {entities.EXPECTED}",
            f"{entities.SAID}/**",
            f"{entities.ESTIMATE}/**",
        ],
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=(1.0, 0.0, CLOSE / float(np.tan(np.deg2rad(55.0) / 2))),
            look_target=(1.0, 0.0, 0.0),
            eye_up=(1.0, 0.0, 0.0),
        ),
        line_grid=False,
        background=palette.FLOOR,
    )
    told = [
        curves("Wheels and laser apart; 1: the limit of chance", entities.APART, most=MOST),
        curves("Beams that fit: by the laser (blue), by the wheels", entities.FIT, most=1.0, around=AROUND),
        curves("Belief that follows the laser (blue), the wheels", entities.FOLLOWED, most=1.0, around=AROUND),
    ]
    return rrb.Vertical(rrb.Horizontal(paths, close), rrb.Horizontal(*told), row_shares=[3, 1], name="Wheels and laser")
