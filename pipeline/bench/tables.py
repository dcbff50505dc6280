"""The table of ranges: to build it, to load it, what it needs."""

from __future__ import annotations

from pipeline.bench.measure import Row, measured, row, seconds
from pipeline.logs.messages import Log
from pipeline.maps.range_table import build_range_table, load_range_table, throwaway_tables


def tables(log: Log, repeats: int) -> list[Row]:
    """Rows of the table that the log's map and laser need, in a cache of its own."""
    assert log.grid is not None
    angles = log.laser.angles
    span = round(float(angles.max() - angles.min()) * 180.0 / 3.141592653589793)
    of_map = (log.grid, log.grid.wall_threshold(None), log.laser.longest(None), min(span, 359))
    (built,) = measured(min(repeats, 3), [lambda: build_range_table(*of_map)])
    with throwaway_tables():
        table = load_range_table(*of_map)
        loaded = [seconds(lambda: load_range_table(*of_map)) for _ in range(repeats + 1)][1:]
    size = (table.wide.nbytes + table.row_of_cell.nbytes + table.cells.nbytes) / 1e6
    return [
        row(f"table of ranges, {len(table.cells):,} cells: build", "s", built),
        row("table of ranges: load from the cache", "ms", [1e3 * s for s in loaded]),
        row("table of ranges: memory", "MB", [size]),
    ]
