"""How the entities look: logged once, as static data, so that every viewer draws them alike."""

from __future__ import annotations

from typing import Any

import numpy as np
import rerun as rr

from pipeline.geometry import yaw_to_quaternion
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.recording import entities, palette

# Widths in screen points stay visible when a whole building fills the window.
CLOSE_REACH = 4.2
"""m from the robot, to the left and below, at which its bar of 1 m begins."""
_thin, _line, _thick, _dot = (rr.Radius.ui_points(size) for size in (0.5, 1.0, 1.5, 2.0))


def styles() -> dict[str, list[Any]]:
    """Static archetypes by entity."""
    return {
        entities.PARTICLES: [rr.Points3D.from_fields(radii=_dot), rr.Arrows3D.from_fields(radii=_thin)],
        entities.HINDSIGHT: [rr.LineStrips3D.from_fields(radii=_line, colors=palette.HINDSIGHT)],
        entities.HITS: [rr.LineStrips3D.from_fields(radii=_thin, colors=palette.HIT)],
        entities.SHORTS: [rr.LineStrips3D.from_fields(radii=_thin, colors=palette.SHORT)],
        entities.LONGS: [rr.LineStrips3D.from_fields(radii=_thin, colors=palette.LONG)],
        entities.NO_RETURN: [rr.LineStrips3D.from_fields(radii=_thin, colors=palette.NO_RETURN)],
        entities.EXPECTED: [rr.Points3D.from_fields(radii=_dot, colors=palette.EXPECTED)],
        entities.COVARIANCE: [rr.Ellipsoids3D.from_fields(line_radii=_line, colors=palette.ESTIMATE)],
        entities.HYPOTHESES: [
            rr.Ellipsoids3D.from_fields(line_radii=_line, colors=palette.HYPOTHESIS, show_labels=False)
        ],
        entities.SHARES: [rr.Points3D.from_fields(radii=_thin, colors=palette.LETTERING, show_labels=True)],
        entities.PATH: [rr.LineStrips3D.from_fields(radii=_thick, colors=palette.ESTIMATE)],
        entities.TRUTH_PATH: [rr.LineStrips3D.from_fields(radii=_line, colors=palette.TRUTH)],
        **robot(entities.ESTIMATE_BODY, entities.ESTIMATE_HEADING, palette.ESTIMATE),
        **robot(entities.TRUTH_BODY, entities.TRUTH_HEADING, palette.TRUTH),
        entities.WEIGHTS: [_bars(palette.NEUTRAL, -1.0)],
        entities.WEIGHT_SHARE: [_bars(palette.ESTIMATE, 1.0)],
        entities.ESS: [_curve("effective sample size", palette.CURVE)],
        entities.PARTICLE_COUNT: [_curve("particles", palette.NEUTRAL)],
        entities.LIKELIHOOD: [_curve("likelihood per beam, 1/m", palette.HIT)],
        entities.EXPLAINED: [_curve("beams that fit", palette.CURVE)],
        entities.SPREAD: [_curve("spread, m", palette.ESTIMATE)],
        entities.VERDICT: [
            rr.StateConfiguration(values=list(palette.VERDICTS), colors=[(*c, 255) for c in palette.VERDICTS.values()])
        ],
        entities.PROBABILITY: [_curve("estimate is right", palette.ESTIMATE)],
        entities.SHORT: [_curve("stop short", palette.SHORT)],
        entities.THROUGH: [_curve("pass through", palette.THROUGH)],
    }


def drawn_map(grid: OccupancyGrid) -> rr.GridMap:
    """The map, the darker the likelier a wall; what it does not know is as grey as the background."""
    shade = np.round(255 * (1 - np.nan_to_num(grid.occupancy)))
    cells = np.where(grid.known, shade, palette.UNKNOWN[0]).astype(np.uint8)
    x, y, yaw = grid.origin
    return rr.GridMap(
        data=np.ascontiguousarray(cells[::-1]).tobytes(),  # a picture's first row is its top
        format=rr.components.ImageFormat(width=grid.width, height=grid.height, color_model="L", channel_datatype="U8"),
        cell_size=grid.resolution,
        translation=[x, y, 0.0],
        quaternion=rr.Quaternion(xyzw=yaw_to_quaternion(yaw)),
        colormap=rr.components.Colormap.Grayscale,
    )


def scale_bars(centre: tuple[float, float], size: tuple[float, float]) -> dict[str, Any]:
    """A bar of a round length in the map's lower left corner, and one of 1 m that stays with the robot."""
    sixth = max(size) / 6
    decade = 10.0 ** np.floor(np.log10(sixth))
    length = float(decade * max(step for step in (1, 2, 5) if step * decade <= sixth))
    x, y = centre[0] - size[0] / 2 + 0.01 * size[0], centre[1] - size[1] / 2 + 0.07 * size[1]  # its label is below
    return {
        entities.SCALE_BAR: _bar(x, y, length, max(size) / 100),
        entities.CLOSE_BAR: _bar(-CLOSE_REACH, -CLOSE_REACH, 1.0, 0.1),
    }


def _bar(x: float, y: float, length: float, height: float) -> Any:
    corners = [(x, y + height), (x, y), (x + length, y), (x + length, y + height)]
    strip = [(*corner, 0.13) for corner in corners]
    return rr.LineStrips3D([strip], radii=_line, colors=palette.LETTERING, labels=[f"{length:g} m"], show_labels=True)


def robot(body: str, heading: str, colour: palette.Colour) -> dict[str, list[Any]]:
    """A circle and an arrow ahead, below whatever moves with it."""
    angles = np.linspace(0.0, 2 * np.pi, 33)
    outline = 0.3 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
    return {
        body: [rr.LineStrips3D([outline], radii=_thick, colors=colour)],
        heading: [rr.Arrows3D(vectors=[[1.0, 0.0, 0.0]], radii=_thick, colors=colour)],
    }


def _curve(name: str, colour: palette.Colour) -> Any:
    return rr.SeriesLines(colors=colour, names=name, widths=1.5)


def _bars(colour: palette.Colour, side: float) -> list[Any]:
    # Two histograms share a view: their bars stand side by side in each bin, side = -1 and 1.
    low, high = palette.HISTOGRAM_RANGE
    width = (high - low) / palette.HISTOGRAM_BINS
    centres = (low + width * (np.arange(palette.HISTOGRAM_BINS) + 0.5 + side / 4)).astype(np.float32)
    widths = np.full(palette.HISTOGRAM_BINS, width / 2, np.float32)
    chart = rr.BarChart(centres, abscissa=centres, widths=widths, color=colour)
    # The heights come with the scans. (`BarChart.from_fields` insists on them.)
    return [b for b in chart.as_component_batches() if b.component_descriptor() != rr.BarChart.descriptor_values()]
