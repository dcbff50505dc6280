"""A run in rows and columns, as CSV and Parquet: one row per scan, or one per particle."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.errors import MclError
from pipeline.export.run import Run
from pipeline.recording import palette

TABLES = (".csv", ".parquet")
"""Suffixes of tables."""


def scans_table(run: Run) -> pa.Table:
    """A row per scan: the estimate, exact, with its covariance; diagnostics; the truth, to 4 mm; what happened.

    Metres and radians in the map frame, ``stamp`` in ns, ``time`` in s since the first scan; null where unknown.
    """
    told, scenes = run.told, run.scenes
    covariance = told.covariances
    happened: dict[int, list[str]] = {}
    for event in told.events:
        happened.setdefault(event.scan, []).append(event.text)
    columns: dict[str, Any] = {
        "scan": told.scan_indices,
        "stamp": told.stamps,
        "time": told.times,
        **{name: told.poses[:, k] for k, name in enumerate(("x", "y", "yaw"))},
        **{
            f"cov_{a}_{b}": covariance[:, i, j]
            for i, a in enumerate(("x", "y", "yaw"))
            for j, b in enumerate(("x", "y", "yaw"))
            if j >= i
        },
        **scenes.curves,
    }
    if not np.isnan(scenes.truth).all():
        columns |= {f"true_{name}": scenes.truth[:, k] for k, name in enumerate(("x", "y", "yaw"))}
    columns["event"] = [" ".join(happened.get(scan, [])) or None for scan in told.scan_indices.tolist()]
    return pa.table({name: pa.array(values, from_pandas=True) for name, values in columns.items()})


def particles_table(run: Run) -> pa.Table:
    """A row per recorded particle: scan, pose (to 4 mm and 1 degree), log10 of weight / mean weight (16 levels)."""
    scenes = run.scenes
    rows = np.repeat(np.arange(len(scenes)), scenes.particles.lengths)
    low, high = palette.COLOUR_RANGE
    width = (high - low) / len(palette.WEIGHT_COLOURS)
    x, y, yaw = scenes.particles.values.astype(np.float32).T
    weight = (low + (scenes.levels.values + 0.5) * width).astype(np.float32)
    return pa.table(
        {"scan": scenes.scans[rows], "time": scenes.times[rows], "x": x, "y": y, "yaw": yaw, "log10_weight": weight}
    )


def write_table(table: pa.Table, path: Path) -> None:
    """In the format of the suffix. Raises MclError if it cannot be written."""
    import pyarrow.csv
    import pyarrow.parquet

    try:
        if path.suffix.lower() == ".csv":
            pyarrow.csv.write_csv(table, path, pyarrow.csv.WriteOptions(quoting_style="needed"))
        else:
            pyarrow.parquet.write_table(table, path, compression="zstd")
    except pa.ArrowException as error:
        raise MclError(f"cannot write the table: {error}", path=path) from error
