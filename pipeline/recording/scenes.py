"""What a recording draws, scan by scan, as plain arrays: for pictures, movies and pages that need no viewer.

Positions are those drawn, rounded to 4 mm; the exact estimate is what `inspect` reads.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.geometry import Pose, quaternion_to_yaw
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.recording import entities, palette
from pipeline.recording.rrd_file import RrdFile

CURVES: Mapping[str, str] = {
    "ess": entities.ESS,
    "particles": entities.PARTICLE_COUNT,
    "likelihood": entities.LIKELIHOOD,
    "explained": entities.EXPLAINED,
    "spread": entities.SPREAD,
}
"""Name and entity of what is plotted over time."""


@dataclass(frozen=True)
class Ragged:
    """n rows of different lengths: row i is ``values[offsets[i]:offsets[i + 1]]``; ``offsets`` (n + 1,)."""

    values: NDArray[Any]
    offsets: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def __getitem__(self, row: int) -> NDArray[Any]:
        return self.values[self.offsets[row] : self.offsets[row + 1]]

    @property
    def lengths(self) -> NDArray[np.int64]:
        """How long every row is, (n,)."""
        return np.diff(self.offsets)

    def at(self, rows: NDArray[np.int64]) -> Ragged:
        """These rows in this order; -1 becomes an empty row."""
        if len(rows) == len(self) and (rows == np.arange(len(rows))).all():
            return self
        lengths = np.where(rows >= 0, self.lengths[rows], 0) if len(self) else np.zeros(len(rows), np.int64)
        offsets = np.concatenate([[0], np.cumsum(lengths)])
        starts = np.repeat(self.offsets[rows] - offsets[:-1], lengths) if len(self) else np.empty(0, np.int64)
        return Ragged(self.values[starts + np.arange(offsets[-1])], offsets)


@dataclass(frozen=True)
class Scenes:
    """n scans as they are drawn; metres and radians in the map frame.

    ``shades`` (height, width) uint8 of ``grid``, row 0 at the lowest y; ``scans`` (n,) and ``times`` (n,) s;
    ``particles`` rows (m, 3), ``levels`` rows (m,) uint8, index into palette.WEIGHT_COLOURS;
    ``estimates`` (n, 3); ``lasers`` (n, 3); rows (k, 2) of where beams end, ``hits``, ``shorts``, ``longs`` and
    ``no_return``, and where the map ends them, ``expected``;
    ``ellipses`` and ``hypotheses``: rows (k, 5), x, y, half axes (2 sigma) and turn;
    ``labels``: the texts at a scan's hypotheses; ``captions``: what is the matter, in Markdown, empty if not recorded;
    ``joined`` (n,): the path goes on from the scan before;
    ``truth`` (n, 3), NaN where unknown; ``hindsight``: rows (k, 2), a piece of the path each;
    ``heat`` rows (m, 3): what a search of the building found, x, y and a level, in the scans that show it;
    ``changed`` rows (m, 3): cells where the world is not as mapped, x, y and index into palette.CHANGED_COLOURS; a row
    for each time that more was known of them, true from the scan of row ``changed_at`` (u,) on until the next;
    ``curves``: (n,) by the names of CURVES, NaN where there is none.
    """

    grid: OccupancyGrid
    shades: NDArray[np.uint8]
    scans: NDArray[np.int64]
    times: NDArray[np.float64]
    particles: Ragged
    levels: Ragged
    estimates: NDArray[np.float64]
    lasers: NDArray[np.float64]
    hits: Ragged
    shorts: Ragged
    longs: Ragged
    no_return: Ragged
    expected: Ragged
    ellipses: Ragged
    hypotheses: Ragged
    labels: tuple[tuple[str, ...], ...]
    captions: tuple[str, ...]
    joined: NDArray[np.bool_]
    truth: NDArray[np.float64]
    hindsight: Ragged
    heat: Ragged
    changed: Ragged
    changed_at: NDArray[np.int64]
    curves: Mapping[str, NDArray[np.float64]]

    def __len__(self) -> int:
        return len(self.scans)

    def row_at(self, time: float) -> int:
        """The row of the last scan until ``time``; the first one before it."""
        return max(int(np.searchsorted(self.times, time, side="right")) - 1, 0)


def read_scenes(file: RrdFile) -> Scenes:
    """Everything that is drawn of every scan whose estimate was recorded; MclError if there is no map or no scan."""
    tables = _Tables(file)
    cells = tables.static(entities.MAP)
    if cells is None:
        raise MclError("the recording holds no map")
    grid, shades = _map(cells)
    record = tables.temporal(entities.RECORD)
    if record is None or not len(record):
        raise MclError("the recording holds no scans", "was the run stopped before its first batch of them?")
    scans = record[entities.SCAN].to_numpy()
    times = record[entities.TIME].cast(pa.int64()).to_numpy() / 1e9
    n = len(scans)

    def rows(entity: str) -> tuple[pa.Table | None, NDArray[np.int64]]:
        table = tables.temporal(entity)
        return table, _rows(scans, np.empty(0, np.int64) if table is None else table[entities.SCAN].to_numpy())

    def ragged(entity: str, component: str, *shape: int) -> Ragged:
        table, at = rows(entity)
        if table is None or component not in table.column_names:
            return Ragged(np.empty((0, *shape)), np.zeros(n + 1, np.int64))
        return _ragged(table[component], *shape).at(at)

    def single(entity: str, component: str, *shape: int) -> NDArray[np.float64]:
        found = ragged(entity, component, *shape)
        whole = np.full((n, *shape), np.nan)
        whole[found.lengths > 0] = found.values[found.offsets[:-1][found.lengths > 0]]
        return whole

    def texts(entity: str, component: str) -> tuple[tuple[str, ...], ...]:
        table, at = rows(entity)
        if table is None or component not in table.column_names:
            return ((),) * n
        told = table[component].to_pylist()
        return tuple(tuple(told[row] or ()) if row >= 0 else () for row in at)

    def poses(entity: str) -> NDArray[np.float64]:
        places = single(entity, "Transform3D:translation", 3)[:, :2]
        return np.column_stack([places, _yaw(single(entity, "Transform3D:quaternion", 4))])

    def ellipses(entity: str) -> Ragged:
        centres, sizes = ragged(entity, "Ellipsoids3D:centers", 3), ragged(entity, "Ellipsoids3D:half_sizes", 3)
        turns = ragged(entity, "Ellipsoids3D:quaternions", 4)
        five = np.column_stack([centres.values[:, :2], sizes.values[:, :2], _yaw(turns.values)])
        return Ragged(five, centres.offsets)

    lasers = poses(entities.LASER)

    def tips(entity: str, component: str, *shape: int) -> Ragged:
        found = ragged(entity, component, *shape)
        ends = (found.values[:, -1] if len(shape) == 2 else found.values)[:, :2]  # of a strip, its last point
        x, y, yaw = np.repeat(lasers, found.lengths, axis=0).T
        cos, sin = np.cos(yaw), np.sin(yaw)
        turned = np.column_stack([x + cos * ends[:, 0] - sin * ends[:, 1], y + sin * ends[:, 0] + cos * ends[:, 1]])
        return Ragged(turned, found.offsets)

    particles, levels = (found.at(rows(entities.PARTICLES)[1]) for found in _particles(tables))
    labels, captions = texts(entities.SHARES, "Points3D:labels"), texts(entities.CAPTION, "TextDocument:text")
    changed, changed_at = _changed(tables.temporal(entities.CHANGED), scans)
    return Scenes(
        grid=grid,
        shades=shades,
        scans=scans,
        times=times,
        particles=particles,
        levels=levels,
        estimates=_ragged(record[f"{entities.RECORD_TYPE}:pose"]).values.reshape(-1, 3).astype(np.float64),
        lasers=lasers,
        hits=tips(entities.HITS, "LineStrips3D:strips", 2, 3),
        shorts=tips(entities.SHORTS, "LineStrips3D:strips", 2, 3),
        longs=tips(entities.LONGS, "LineStrips3D:strips", 2, 3),
        no_return=tips(entities.NO_RETURN, "LineStrips3D:strips", 2, 3),
        expected=tips(entities.EXPECTED, "Points3D:positions", 3),
        ellipses=ellipses(entities.COVARIANCE),
        hypotheses=ellipses(entities.HYPOTHESES),
        labels=labels,
        captions=tuple(row[0] if row else "" for row in captions),
        joined=ragged(entities.PATH, "LineStrips3D:strips", 2, 3).lengths > 0,
        truth=poses(entities.TRUTH),
        hindsight=_hindsight(tables.static(entities.HINDSIGHT)),
        heat=_heat(tables.temporal(entities.HEAT), scans),
        changed=changed,
        changed_at=changed_at,
        curves={name: single(entity, "Scalars:scalars") for name, entity in CURVES.items()},
    )


class _Tables:
    """The chunks of every entity, put together; rows of a timeline in its order."""

    def __init__(self, file: RrdFile) -> None:
        self._chunks: dict[tuple[str, bool], list[Any]] = defaultdict(list)
        for chunk in file.chunks:
            self._chunks[chunk.entity_path, chunk.is_static].append(chunk)

    def static(self, entity: str) -> pa.Table | None:
        return self._put_together(entity, True)

    def temporal(self, entity: str) -> pa.Table | None:
        table = self._put_together(entity, False)
        if table is None:
            return None
        order = np.argsort(table[entities.SCAN].to_numpy(), kind="stable")
        # A copy for its own sake costs time: chunks nearly always come in order.
        return table if (np.diff(order) == 1).all() else table.take(pa.array(order))

    def _put_together(self, entity: str, static: bool) -> pa.Table | None:
        parts = [
            pa.Table.from_batches([chunk.to_record_batch()]).replace_schema_metadata()
            for chunk in self._chunks[entity, static]
            if static or entities.SCAN in chunk.timeline_names
        ]
        return pa.concat_tables(parts, promote_options="default") if parts else None


def _rows(wanted: NDArray[np.int64], have: NDArray[np.int64]) -> NDArray[np.int64]:
    """For every wanted scan the row that has it, or -1: a file cut short may lack the last rows of some entities."""
    at = np.searchsorted(have, wanted)
    inside = np.minimum(at, len(have) - 1)
    return np.where((at < len(have)) & (have[inside] == wanted), inside, -1) if len(have) else np.full(len(wanted), -1)


def _particles(tables: _Tables) -> tuple[Ragged, Ragged]:
    """Poses (k, 3) float32 and levels (k,) uint8 of all rows there are; batch by batch, for they are most of a file."""
    table = tables.temporal(entities.PARTICLES)
    poses, levels = [np.empty((0, 3), np.float32)], [np.empty(0, np.uint8)]
    lengths = [np.empty(0, np.int64)]
    for batch in table.to_batches() if table is not None else ():
        places, vectors = _ragged(batch["Points3D:positions"], 3), _ragged(batch["Arrows3D:vectors"], 3).values
        headings = np.arctan2(vectors[:, 1], vectors[:, 0])
        poses.append(np.column_stack([places.values[:, :2], headings]))
        levels.append(_levels(_ragged(batch["Points3D:colors"]).values))
        lengths.append(places.lengths)
    offsets = np.concatenate([[0], np.cumsum(np.concatenate(lengths))])
    return Ragged(np.concatenate(poses), offsets), Ragged(np.concatenate(levels), offsets)


def _ragged(column: Any, *shape: int) -> Ragged:
    lists = column.combine_chunks() if isinstance(column, pa.ChunkedArray) else column
    lengths = pc.fill_null(pc.list_value_length(lists), 0).to_numpy(zero_copy_only=False).astype(np.int64)
    values = lists.flatten()
    while pa.types.is_list(values.type) or pa.types.is_fixed_size_list(values.type):
        values = values.flatten()
    flat = values.to_numpy(zero_copy_only=False)
    return Ragged(flat.reshape(-1, *shape), np.concatenate([[0], np.cumsum(lengths)]))


def _yaw(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    return quaternion_to_yaw(*quaternions.T.astype(np.float64))


def _levels(colours: NDArray[np.uint32]) -> NDArray[np.uint8]:
    """Index into palette.WEIGHT_COLOURS of packed RGBA."""
    rgb = palette.WEIGHT_COLOURS.astype(np.int64)
    packed = (rgb[:, 0] << 16) + (rgb[:, 1] << 8) + rgb[:, 2]
    order = np.argsort(packed)
    at = np.searchsorted(packed[order].astype(np.uint32), colours.astype(np.uint32) >> np.uint32(8))
    return order.astype(np.uint8)[np.minimum(at, len(order) - 1)]


def _map(table: pa.Table) -> tuple[OccupancyGrid, NDArray[np.uint8]]:
    first: Callable[[str], Any] = lambda name: table[f"GridMap:{name}"][0].as_py()[0]  # noqa: E731
    picture = first("format")
    cells = table["GridMap:data"].combine_chunks().flatten().flatten().to_numpy(zero_copy_only=False).astype(np.uint8)
    shades = np.ascontiguousarray(cells.reshape(picture["height"], picture["width"])[::-1])
    known = shades != palette.UNKNOWN[0]
    x, y, _ = first("translation")
    origin: Pose = (x, y, float(_yaw(np.array(first("quaternion")))))
    occupancy = np.where(known, 1.0 - shades / 255.0, np.nan).astype(np.float32)
    return OccupancyGrid(occupancy, float(np.float32(first("cell_size"))), origin), shades


def _hindsight(table: pa.Table | None) -> Ragged:
    empty = Ragged(np.empty((0, 2)), np.zeros(1, np.int64))
    if table is None or "LineStrips3D:strips" not in table.column_names:
        return empty
    pieces = [row for row in table["LineStrips3D:strips"].to_pylist() if row]
    if not pieces:
        return empty
    strips = [np.array(strip, dtype=np.float64).reshape(-1, 3)[:, :2] for strip in pieces[-1]]
    return Ragged(np.concatenate(strips), np.concatenate([[0], np.cumsum([len(s) for s in strips])]))


def _heat(table: pa.Table | None, scans: NDArray[np.int64]) -> Ragged:
    """A search stays until a later row, mostly an empty one, takes its place."""
    if table is None:
        return Ragged(np.empty((0, 3)), np.zeros(len(scans) + 1, np.int64))
    places, colours = _ragged(table["Points3D:positions"], 3), _ragged(table["Points3D:colors"])
    three = Ragged(np.column_stack([places.values[:, :2], _levels(colours.values)]), places.offsets)
    return three.at(np.searchsorted(table[entities.SCAN].to_numpy(), scans, side="right") - 1)


def _changed(table: pa.Table | None, scans: NDArray[np.int64]) -> tuple[Ragged, NDArray[np.int64]]:
    if table is None:
        return Ragged(np.empty((0, 3)), np.zeros(1, np.int64)), np.empty(0, np.int64)
    places, colours = _ragged(table["Points3D:positions"], 3), _ragged(table["Points3D:colors"])
    known = palette.CHANGED_COLOURS.astype(np.int64) @ np.array([1 << 16, 1 << 8, 1])
    order = np.argsort(known)
    kinds = order[np.searchsorted(known[order], colours.values.astype(np.int64) >> 8)]
    three = Ragged(np.column_stack([places.values[:, :2], kinds]), places.offsets)
    return three, np.searchsorted(scans, table[entities.SCAN].to_numpy())
