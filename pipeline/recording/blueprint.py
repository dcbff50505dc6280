"""What a viewer shows when it opens the recording: the map large, and beside it what the belief does over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.recording import entities, palette

MARGIN = 1.05  # of the known area, left free around it
ASPECT = 1.6  # of the map view in the layout below
FIELD_OF_VIEW = np.deg2rad(55.0)  # of the viewer's 3D camera, measured vertically
FLAT_PIXELS = 1000.0  # along the longer side of the flat view
FLAT_HEIGHT = 40.0  # metres; from much higher, points are drawn with the noise of float32


@dataclass(frozen=True)
class Area:
    """The part of the map frame that is worth looking at: ``centre`` (x, y) and ``size`` (x, y) in metres."""

    centre: tuple[float, float]
    size: tuple[float, float]
    height: float = FLAT_HEIGHT

    @property
    def pixels_per_metre(self) -> float:
        """Scale of the flat view."""
        return FLAT_PIXELS / max(self.size)

    @property
    def pixels(self) -> tuple[float, float]:
        """Width and height of the flat view."""
        return (self.size[0] * self.pixels_per_metre, self.size[1] * self.pixels_per_metre)

    def eye_height(self, aspect: float = ASPECT) -> float:
        """From where a 3D camera sees all of it, metres, in a view of this width over height."""
        return max(self.size[1], self.size[0] / aspect) / 2 / float(np.tan(FIELD_OF_VIEW / 2))


def known_area(grid: OccupancyGrid) -> Area:
    """Bounding box of the cells that the map knows, with a margin; of the whole map if it knows none."""
    rows, columns = np.nonzero(grid.known)
    if len(rows) == 0:
        rows, columns = np.array([0, grid.height - 1]), np.array([0, grid.width - 1])
    x0, x1 = columns.min() * grid.resolution, (columns.max() + 1) * grid.resolution
    y0, y1 = rows.min() * grid.resolution, (rows.max() + 1) * grid.resolution
    corners = grid.to_map([(x0, y0, 0), (x1, y0, 0), (x1, y1, 0), (x0, y1, 0)])[:, :2]
    low, high = corners.min(axis=0), corners.max(axis=0)
    centre, size = (low + high) / 2, (high - low) * MARGIN
    return Area((float(centre[0]), float(centre[1])), (float(size[0]), float(size[1])))


def blueprint(
    grid: OccupancyGrid, *, tab: int = 0, motion: rrb.Container | None = None, substeps: rrb.Container | None = None
) -> rrb.Blueprint:
    """The layout for a run on this map, with that tab in front: 0 the map, 1 the flat map, 2 and on the others.

    ``motion``: a tab about the witnesses of motion, the third, where there is more than one. ``substeps``: a window
    of its own about the parts of a turn, in front of all that, with its own timeline.
    """
    beside = [
        rrb.BarChartView(
            name="Weights: log10(weight / mean weight), %",
            contents=[entities.WEIGHTS, entities.WEIGHT_SHARE],
            plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
        ),
        curves("Effective sample size and particles", entities.ESS, entities.PARTICLE_COUNT),
        curves("Beams explained; estimate right", entities.EXPLAINED, entities.PROBABILITY, most=1.0),
        curves("Beams short of what is mapped, and behind it", entities.SHORT, entities.THROUGH, most=1.0),
        curves("Likelihood per beam, 1/m", entities.LIKELIHOOD),
        curves("Spread of the particles, m", entities.SPREAD),
    ]
    documents = [
        rrb.TextDocumentView(origin=entities.EXPLANATION, name="What you see"),
        rrb.TextDocumentView(origin=entities.RUN, name="Run"),
        rrb.TextDocumentView(origin=entities.RESULT, name="Result"),
        rrb.Vertical(
            rrb.BarChartView(origin=entities.DENSITY, name="p(z | z*), per metre, over z, m"),
            rrb.TextDocumentView(origin=entities.DENSITY_NOTE, name="The beam model"),
            row_shares=[3, 1],
            name="Sensor model",
        ),
    ]
    events = rrb.TextLogView(
        origin=entities.EVENTS,
        name="Events",
        # The sentences say when: rerun makes a column as wide as its title, which is too narrow for times.
        columns=rrb.TextLogColumns(timeline_columns=[entities.TIME], text_log_columns=["loglevel", "body"]),
    )
    verdict = rrb.StateTimelineView(origin=entities.VERDICT, name="The estimate is")
    told = [] if motion is None else [motion]
    tabs = rrb.Tabs(*map_views(known_area(grid)), *told, *documents, active_tab=tab)
    curves_beside = rrb.Vertical(*beside, row_shares=[3, 2, 2, 2, 2, 2])
    if substeps is None:
        return framed(arranged(tabs, events, curves_beside, verdict))
    whole = arranged(tabs, events, curves_beside, verdict, name=f"Scan by scan (timeline {entities.TIME})")
    return framed(rrb.Tabs(whole, substeps, active_tab=1), entities.SUBSTEP)


def arranged(
    tabs: rrb.Tabs,
    events: rrb.View,
    beside: rrb.Vertical,
    verdict: rrb.View | None = None,
    name: str | None = None,
) -> rrb.Container:
    """The window of a recording: tabs with the verdict and the events below them, curves beside all."""
    below = [events] if verdict is None else [verdict, events]
    main = rrb.Vertical(tabs, *below, row_shares=[15, *([2] * (len(below) - 1)), 3])
    return rrb.Horizontal(main, beside, column_shares=[5, 2], name=name)


def framed(content: rrb.Container, timeline: str = entities.TIME) -> rrb.Blueprint:
    """A window of nothing but these views: rerun's own panels are away, and the cursor waits on the timeline."""
    return rrb.Blueprint(
        content,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=timeline, play_state="paused", playback_speed=4.0),
        auto_views=False,
        auto_layout=False,
    )


def map_views(area: Area, *, below: str = "", name: str = "Map", aspect: float = ASPECT) -> list[rrb.View]:
    """The map from above and the same flat, of entities that hang ``below`` a path, in views of this shape."""
    contents = [f"{below}{entities.WORLD}/**", f"- {below}{entities.WALLS}"]
    shared: dict[str, Any] = {"contents": contents, "overrides": _overrides(below)}
    width, height = area.pixels
    return [
        rrb.Spatial3DView(
            origin=below + entities.WORLD,
            name=name,
            eye_controls=looking_down(area, aspect),
            line_grid=False,
            background=palette.UNKNOWN,
            **shared,
        ),
        rrb.Spatial2DView(
            origin=below + entities.CAMERA,
            name=f"{name}, flat",
            visual_bounds=rrb.VisualBounds2D(x_range=[0.0, width], y_range=[0.0, height]),
            background=palette.UNKNOWN,
            **shared,
        ),
    ]


def looking_down(area: Area, aspect: float = ASPECT) -> rrb.EyeControls3D:
    """A camera above the area that sees all of it in a view of this width over height, north up."""
    x, y = area.centre
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=(x, y, area.eye_height(aspect)),
        look_target=(x, y, 0.0),
        eye_up=(0.0, 1.0, 0.0),
    )


def so_far() -> rrb.VisibleTimeRanges:
    """Shows what is a segment per scan up to the cursor, so that a path grows as one scrubs."""
    return rrb.VisibleTimeRanges(
        [
            rrb.VisibleTimeRange(
                timeline, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
            )
            for timeline in (entities.SCAN, entities.TIME)
        ]
    )


def _overrides(below: str) -> dict[str, Any]:
    # Headings start at the points they belong to; storing the origins again would add half of the file.
    def same(target: str, source: str) -> VisualizerComponentMapping:
        return VisualizerComponentMapping(
            target=target, source_kind=ComponentSourceKind.SourceComponent, source_component=source
        )

    arrows = rr.Arrows3D.from_fields().visualizer(
        mappings=[same("Arrows3D:origins", "Points3D:positions"), same("Arrows3D:colors", "Points3D:colors")]
    )
    return {
        below + entities.PARTICLES: [rr.Points3D.from_fields().visualizer(), arrows],
        below + entities.PATH: so_far(),
        below + entities.TRUTH_PATH: so_far(),
    }


def curves(name: str, *shown: str, most: float | None = None, around: float | None = None) -> rrb.TimeSeriesView:
    """Curves with a legend if there are several; from 0 to ``most`` if that is known; over the whole run, or so many
    seconds ``around`` the cursor."""
    begin = end = rrb.TimeRangeBoundary.infinite()
    if around is not None:
        begin, end = (rrb.TimeRangeBoundary.cursor_relative(seconds=by) for by in (-around, around))
    return rrb.TimeSeriesView(
        name=name,
        contents=list(shown),
        axis_x=rrb.TimeAxis(view_range=rrb.TimeRange(start=begin, end=end)),
        axis_y=None if most is None else rrb.ScalarAxis(range=(0.0, most), zoom_lock=True),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=len(shown) > 1),
    )
