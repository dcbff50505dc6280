"""Writes a learned sensor model as a rerun recording: what was measured beside what the model says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.recording import entities, palette

Array = NDArray[np.float64]

MEASURED, BEFORE, AFTER = "/fit/residuals/measured", "/fit/residuals/before", "/fit/residuals/after"
PLANE_MEASURED, PLANE_FITTED, PRESET = "/fit/plane/measured", "/fit/plane/fitted", "/fit/preset"


def write_fit(
    path: Path, name: str, at: Array, residuals: tuple[Array, Array, Array], planes: tuple[Array, Array], preset: str
) -> None:
    """One static recording of the densities of residuals and of the plane of ranges, with the preset as text.

    ``at`` (k,) m; ``residuals``: measured, before, after, each (k,) per metre; ``planes``: measured and fitted,
    (n, n) per metre, row 0 the shortest measured range, NaN unknown. Raises MclError if the file exists already.
    """
    if path.exists():
        raise MclError("this recording exists already and is never overwritten", path=path)
    rr.set_strict_mode(True)
    stream = rr.RecordingStream(entities.APPLICATION_ID, recording_id=f"tune-{name}")
    try:
        stream.save(path, default_blueprint=_blueprint())
    except Exception as error:
        raise MclError(f"cannot write the recording: {error}", path=path) from error
    colours = (palette.NEUTRAL, palette.CURVE, palette.HIT)
    for entity, density, colour in zip((MEASURED, BEFORE, AFTER), residuals, colours, strict=True):
        stream.log(entity, rr.BarChart(density.astype(np.float32), abscissa=at, color=colour), static=True)
    for entity, plane in zip((PLANE_MEASURED, PLANE_FITTED), planes, strict=True):
        # A picture's first row is its top; decades, since the tails lie far below the peak.
        decades = np.log10(np.clip(np.nan_to_num(plane[::-1], nan=1e-3), 1e-3, 10.0)) + 3.0
        image = rr.DepthImage(decades.astype(np.float32), meter=1.0, colormap="viridis", depth_range=(0.0, 4.0))
        stream.log(entity, image, static=True)
    text = rr.TextDocument(f"# {name}\n\n```yaml\n{preset}```\n", media_type=rr.MediaType.MARKDOWN)
    stream.log(PRESET, text, static=True)
    stream.flush()
    stream.disconnect()


def _blueprint() -> rrb.Blueprint:
    charts = [
        rrb.BarChartView(origin=entity, name=f"z - z*: {entity.rpartition('/')[2]}")
        for entity in (MEASURED, BEFORE, AFTER)
    ]
    planes = [
        rrb.Spatial2DView(origin=entity, name=f"z over z*: {entity.rpartition('/')[2]}")
        for entity in (PLANE_MEASURED, PLANE_FITTED)
    ]
    document = rrb.TextDocumentView(origin=PRESET, name="preset")
    return rrb.Blueprint(rrb.Horizontal(rrb.Vertical(*charts), rrb.Vertical(*planes), document), collapse_panels=True)
