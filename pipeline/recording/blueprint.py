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
from pipeline.recording.scales import Scales

MARGIN = 1.05  # of the known area, left free around it
ASPECT = 1.6  # of the map view in the layout below
MAP_ASPECT = 1.7  # of the map beside the robot close up
FULL = 1.05  # of a share: so that its axis has a mark at 1
CLOSE, CLOSER = 6.0, 7.0  # metres seen above and below the robot, beside the map and alone
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
    grid: OccupancyGrid,
    *,
    scales: Scales | None = None,
    truth: bool = True,
    tab: int = 0,
    motion: rrb.Container | None = None,
    substeps: rrb.Container | None = None,
) -> rrb.Blueprint:
    """The layout for a run on this map, with that tab in front: 0 the whole run, 1 one scan, 2 and on the others.

    ``scales``: how high the axes reach; ``truth``: it is known. ``motion``: a tab about the witnesses of motion, the
    third, where there is more than one. ``substeps``: a window of its own about the parts of a turn, in front of all
    that, with its own timeline.
    """
    scales = scales or Scales()
    area = known_area(grid)
    told = [] if motion is None else [motion]
    tabs = [whole_run(area, scales, truth), one_scan(scales), *told, flat_map(area), *documents()]
    if substeps is None:
        return framed(rrb.Tabs(*tabs, active_tab=tab))
    whole = rrb.Tabs(*tabs, active_tab=tab, name=f"Scan by scan (timeline {entities.TIME})")
    return framed(rrb.Tabs(whole, substeps, active_tab=1), entities.SUBSTEP)


def whole_run(area: Area, scales: Scales, truth: bool) -> rrb.Container:
    """What is the matter in words, the whole map and the robot close up, what happened, and the curves of a run."""
    verdict = rrb.StateTimelineView(
        origin=entities.VERDICT, name="What can be trusted, over the whole run", time_view=over_all()
    )
    error = curves("Uncertainty of the place, 2 sigma, m", entities.TWO_SIGMA, most=scales.error)
    if truth:
        error = curves("Error (green) and 2 sigma (grey), m", entities.ERROR, entities.TWO_SIGMA, most=scales.error)
    beside = [
        error,
        curves(
            "Share of beams that fit (orange); right (magenta)", entities.EXPLAINED, entities.PROBABILITY, most=FULL
        ),
        curves("Beams stopped short (vermilion), through (violet)", entities.SHORT, entities.THROUGH, most=FULL),
        curves("Spread of the particles, m", entities.SPREAD, most=scales.spread),
    ]
    happened = rrb.Tabs(
        rrb.TextDocumentView(origin=entities.EVENTS_TABLE, name="What happened until now, the newest first"),
        rrb.TextLogView(
            origin=entities.EVENTS,
            name="All events",
            # The sentences say when: rerun makes a column as wide as its title, which is too narrow for times.
            columns=rrb.TextLogColumns(timeline_columns=[entities.TIME], text_log_columns=["loglevel", "body"]),
        ),
        active_tab=0,
    )
    drawn = "Map. Magenta: as believed" + (", green: the truth" if truth else "") + ", light blue: as known at the end"
    seen = rrb.Horizontal(map_view(area, name=drawn, aspect=MAP_ASPECT), close_view(), column_shares=[8, 5])
    main = rrb.Vertical(caption_view(), seen, verdict, happened, row_shares=[3.0, 10.6, 2.3, 3.4])
    return rrb.Horizontal(main, rrb.Vertical(*beside), column_shares=[11, 4], name="The whole run")


def one_scan(scales: Scales) -> rrb.Container:
    """The robot close up with its beams, the sensor model, and the weights of the particles."""
    sensor = rrb.BarChartView(
        name="What beams measure where the map's range is z*: % of them, over m",
        origin=entities.PARTS,
        plot_legend=rrb.PlotLegend(visible=False),  # it would lie on the bars, whose colours the text below tells
    )
    weights = rrb.BarChartView(
        name="Weights of the particles: log10(weight / mean weight), %",
        contents=[entities.WEIGHTS, entities.WEIGHT_SHARE],
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
    )
    beside = rrb.Vertical(
        weights,
        curves(
            "Particles (grey), effective number (orange)", entities.ESS, entities.PARTICLE_COUNT, most=scales.particles
        ),
        curves("Likelihood per beam, 1/m", entities.LIKELIHOOD, most=scales.likelihood),
        sensor,
        rrb.TextDocumentView(origin=entities.DENSITY_NOTE, name="The sensor model"),
        row_shares=[4, 3, 3, 5, 7],
    )
    main = rrb.Vertical(caption_view(), close_view(CLOSER), row_shares=[1.6, 6])
    return rrb.Horizontal(main, beside, column_shares=[5, 4], name="One scan")


def documents() -> list[rrb.View]:
    """The texts."""
    return [
        rrb.TextDocumentView(origin=entities.EXPLANATION, name="What you see"),
        rrb.TextDocumentView(origin=entities.RUN, name="Run"),
        rrb.TextDocumentView(origin=entities.RESULT, name="Result"),
    ]


def caption_view() -> rrb.View:
    """What is the matter at the cursor, in words."""
    return rrb.TextDocumentView(origin=entities.CAPTION, name="Now", titlebar=False)


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


def map_view(area: Area, *, below: str = "", name: str = "Map", aspect: float = ASPECT) -> rrb.View:
    """The map from above, of entities that hang ``below`` a path, in a view of this shape."""
    return rrb.Spatial3DView(
        origin=below + entities.WORLD,
        name=name,
        eye_controls=looking_down(area, aspect),
        line_grid=False,
        background=palette.UNKNOWN,
        contents=_drawn(below, entities.CLOSE_BAR, entities.WORST),
        overrides=_overrides(below),
    )


def close_view(reach: float = CLOSE) -> rrb.View:
    """The same around the estimate, which stays in the middle, north up; ``reach`` metres to above and below."""
    # A view of what is seen from a place that moves along and never turns: rerun's camera tracks no such entity.
    return rrb.Spatial3DView(
        origin=entities.HERE,
        name="Close up. Beams that fit (blue), short (red)",
        eye_controls=looking_down(Area((0.0, 0.0), (2 * reach, 2 * reach)), 1.0),
        line_grid=False,
        background=palette.UNKNOWN,
        contents=_drawn("", entities.SCALE_BAR),
        overrides=_overrides(""),
    )


def flat_map(area: Area) -> rrb.View:
    """The map as a picture that can be moved and enlarged, but not tilted."""
    width, height = area.pixels
    return rrb.Spatial2DView(
        origin=entities.CAMERA,
        name="Map, flat",
        visual_bounds=rrb.VisualBounds2D(x_range=[0.0, width], y_range=[0.0, height]),
        background=palette.UNKNOWN,
        contents=_drawn("", entities.CLOSE_BAR, entities.WORST),
        overrides=_overrides(""),
    )


def _drawn(below: str, *but: str) -> list[str]:
    left_out = (entities.WALLS, *but)
    return [f"{below}{entities.WORLD}/**", *(f"- {below}{entity}" for entity in left_out)]


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


def over_all(around: float | None = None) -> rrb.TimeAxis:
    """An axis of the whole run, or of so many seconds ``around`` the cursor."""
    begin = end = rrb.TimeRangeBoundary.infinite()
    if around is not None:
        begin, end = (rrb.TimeRangeBoundary.cursor_relative(seconds=by) for by in (-around, around))
    return rrb.TimeAxis(view_range=rrb.TimeRange(start=begin, end=end))


def curves(
    name: str, *shown: str, most: float | None = None, around: float | None = None, legend: bool = False
) -> rrb.TimeSeriesView:
    """Curves from 0 to ``most`` if that is known; over the whole run, or so many seconds ``around`` the cursor.

    ``legend``: which is which, where the name does not tell their colours; it lies on the curves.
    """
    return rrb.TimeSeriesView(
        name=name,
        contents=list(shown),
        axis_x=over_all(around),
        axis_y=None if most is None else rrb.ScalarAxis(range=(0.0, most), zoom_lock=True),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=legend),
    )
