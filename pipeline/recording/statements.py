"""What a recording says of the witnesses of motion at one scan, read back from its chunks."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.geometry import between
from pipeline.motion.words import in_words
from pipeline.recording import entities


@dataclass(frozen=True)
class Statement:
    """Of one scan: ``laser`` and ``wheels``, steps (m, m, rad in the robot's frame) since the scan before, to 4 mm,
    ``wheels`` None where there are none; ``apart``: their disagreement over its 99 % limit, as a deviation; ``fit`` and
    ``fit_by_wheels``: shares of the beams that fit the walls seen before, where either says; ``follows_laser``: share
    of the belief. None: not known at this scan."""

    laser: tuple[float, float, float]
    wheels: tuple[float, float, float] | None
    apart: float | None
    fit: float | None
    fit_by_wheels: float | None
    follows_laser: float | None

    @property
    def sentence(self) -> str:
        """All of it in one line."""
        said = [("laser", self.laser), *([("wheels", self.wheels)] if self.wheels is not None else [])]
        told = [f"{who}: {in_words(np.array(step))}" for who, step in said]
        if self.apart is not None:
            told.append(f"apart: {self.apart:.1f} of the limit of chance")
        if self.fit is not None:
            by_wheels = "" if self.fit_by_wheels is None else f", by the wheels {100 * self.fit_by_wheels:.0f} %"
            told.append(f"beams that fit: by the laser {100 * self.fit:.0f} %{by_wheels}")
        if self.follows_laser is not None:
            told.append(f"{100 * self.follows_laser:.0f} % of the belief follows the laser")
        return "; ".join(told)


class Statements:
    """What the chunks of a recording say of the witnesses; nothing where only the wheels were heard."""

    def __init__(self, chunks: Iterable[Any]) -> None:
        wanted = (entities.HEADS, entities.APART, entities.FIT, entities.FOLLOWED)
        self._chunks: dict[str, list[Any]] = {entity: [] for entity in wanted}
        for chunk in chunks:
            if chunk.entity_path in self._chunks and entities.SCAN in chunk.timeline_names:
                self._chunks[chunk.entity_path].append(chunk)

    def at(self, scan: int) -> Statement | None:
        """What was said at a scan; None if nothing is known."""
        places = self._row(entities.HEADS, "Arrows3D:origins", scan)
        ways = self._row(entities.HEADS, "Arrows3D:vectors", scan)
        earlier = self._row(entities.HEADS, "Arrows3D:origins", scan - 1)
        earlier_ways = self._row(entities.HEADS, "Arrows3D:vectors", scan - 1)
        if places is None or ways is None or earlier is None or earlier_ways is None:
            return None
        steps = [_step(step) for step in between(_poses(earlier, earlier_ways), _poses(places, ways))]
        fits = self._row(entities.FIT, "Scalars:scalars", scan)
        apart, followed = (self._row(e, "Scalars:scalars", scan) for e in (entities.APART, entities.FOLLOWED))
        return Statement(
            laser=steps[-2],
            wheels=steps[0] if len(steps) > 2 else None,
            apart=None if apart is None else float(apart[0]),
            fit=None if fits is None else float(fits[0]),
            fit_by_wheels=None if fits is None or len(fits) < 2 else float(fits[1]),
            follows_laser=None if followed is None else float(followed[0]),
        )

    def _row(self, entity: str, component: str, scan: int) -> NDArray[np.float64] | None:
        for chunk in self._chunks[entity]:
            batch = pa.Table.from_batches([chunk.to_record_batch()])
            if component not in batch.column_names:
                continue
            found = np.flatnonzero(batch[entities.SCAN].to_numpy() == scan)
            if len(found):
                value = np.array(batch[component][int(found[0])].as_py(), np.float64)
                return value if len(value) else None
        return None


def _poses(places: NDArray[np.float64], ways: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([places[:, :2], np.arctan2(ways[:, 1], ways[:, 0])])


def _step(step: NDArray[np.float64]) -> tuple[float, float, float]:
    return (float(step[0]), float(step[1]), float(step[2]))
