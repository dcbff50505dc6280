"""Grid localization as a filter: what a particle filter is measured against."""

from __future__ import annotations

from pipeline.config import Config
from pipeline.filter.grid_belief import GridBelief
from pipeline.filter.particle_filter import ParticleFilter
from pipeline.filter.recovery import Takeover
from pipeline.filter.sensor import Reading
from pipeline.logs.messages import Laser, Scan
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.motion.prior import Prior
from pipeline.motion.witnesses import Motion
from pipeline.world.seen import Seen


class GridFilter(ParticleFilter):
    """The belief as the probability of every cell (Table 8.1), where ``ParticleFilter`` draws particles.

    Witnesses, sensor model and steps are the same. It forgets no place that matters, so it neither searches nor has
    rivals. A step's estimate has as its weight the share of the belief within 0.5 m and 10 degrees of it.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        laser: Laser,
        config: Config,
        seed: int = 0,
        *,
        wheels: bool = True,
        seen: Seen | None = None,  # noqa: ARG002  (a grid remembers nothing of the world)
    ) -> None:
        # Of what it knows everything is on the map that was given.
        alone = {"recovery": "none", "without": (*config.without, "off_map", "memory")}
        super().__init__(grid, laser, config.model_copy(update=alone), seed, wheels=wheels)
        self._cells = GridBelief(grid, config, self._sensor, seed)
        self._belief = self._cells  # type: ignore[assignment]

    def _start(self, scan: Scan, reading: Reading) -> None:
        self._cells.start(reading, scan.index)

    def _advance(
        self,
        scan: Scan,
        reading: Reading,
        motion: Motion,
        prior: Prior,
    ) -> tuple[bool, Takeover | None]:
        carried = motion.unseen is not None and not motion.unseen.driven
        self._cells.advance(prior, reading, scan.index, carried)
        return False, None
