"""How high the axes of the curves reach: what a whole run needs, but for its few highest values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.recording import entities

ROBUST = 0.9
"""Share of a run's values that its axis has room for: a search at the start, with particles far apart, is cut off."""
ROOM = 1.25


@dataclass(frozen=True)
class Scales:
    """The ends of axes that begin at 0. The defaults serve while a run goes on, whose values nobody knows yet."""

    error: float = 2.0  # m
    spread: float = 2.0  # m
    particles: float | None = None  # as the curve has it so far
    likelihood: float | None = None  # 1/m

    @classmethod
    def of(cls, curves: Mapping[str, NDArray[np.float64]]) -> Self:
        """For a whole run, by the values of its curves by entity, (n,) each."""

        def top(least: float | None, *names: str) -> float | None:
            values = [v[np.isfinite(v)] for name in names if len(v := curves.get(name, np.empty(0)))]
            highest = [float(np.quantile(v, ROBUST)) for v in values if len(v)]
            return max([ROOM * max(highest), *([] if least is None else [least])]) if highest else least

        return cls(
            error=top(0.25, entities.ERROR, entities.TWO_SIGMA) or cls.error,
            spread=top(0.25, entities.SPREAD) or cls.spread,
            particles=top(None, entities.PARTICLE_COUNT),
            likelihood=top(None, entities.LIKELIHOOD),
        )

    @classmethod
    def of_chunks(cls, chunks: Iterable[Any]) -> Self:
        """For a run that was recorded, by its chunks."""
        wanted = (entities.ERROR, entities.TWO_SIGMA, entities.SPREAD, entities.PARTICLE_COUNT, entities.LIKELIHOOD)
        found: dict[str, list[NDArray[np.float64]]] = {entity: [] for entity in wanted}
        for chunk in chunks:
            if chunk.entity_path in found and not chunk.is_static:
                column = pa.Table.from_batches([chunk.to_record_batch()])["Scalars:scalars"].combine_chunks()
                found[chunk.entity_path].append(column.flatten().to_numpy(zero_copy_only=False).astype(np.float64))
        return cls.of({entity: np.concatenate(parts) for entity, parts in found.items() if parts})
