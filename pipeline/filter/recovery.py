"""Noticing that the robot is lost, and finding it again."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.config import Config
from pipeline.filter.belief import Belief, patches
from pipeline.filter.initialization import initial_particles
from pipeline.filter.motion_model import OdometryMotion
from pipeline.filter.sensor import Reading, Sensor
from pipeline.filter.step import Step
from pipeline.kernels.random import stream_key
from pipeline.maps.occupancy_grid import OccupancyGrid

RATE = 0.1
"""Share of a new scan in the smoothed share of explained beams: about ten updates of memory."""
DOUBTFUL = 0.6
"""Below this smoothed share a challenger is called. Right poses explain 0.5 to 0.95 of the beams: people, open
doors and rooms that the map lacks take the rest. So doubt is cheap and frequent; the challenger decides."""
MOST_PER_PATCH = 10.0
"""Nats that one patch may count for or against the challenger: a crowd, or a new door, can spoil any."""
MARGIN = 16.0
"""Nats by which a challenger must be ahead to replace the belief: odds of ten million to one, if the scans were
all that the model takes them for. At right poses, where the map was wrong, one has been ahead by 14."""
CHALLENGERS = 5000
"""Particles that a challenger never falls below: several places must live in it side by side."""
PATIENCE = 60.0
"""Seconds after which a challenger that does not win gives way to a fresh one."""
STREAM = 16


@dataclass(frozen=True)
class Verdict:
    """The belief was replaced by a challenger, ``lead`` nats ahead, that had begun ``since`` seconds before."""

    lead: float
    since: float


class Recovery:
    """Watches the belief, in the way that ``config.recovery`` names.

    ``search``: when few beams are explained, a challenger starts from an exhaustive search of the building. The
    evidence that the robot was carried away is the challenger's against the belief's own, patch of floor by patch;
    with a clear lead the challenger takes over.
    ``augmented``: random newcomers as w_slow and w_fast ask for them (Table 8.3).
    """

    def __init__(self, grid: OccupancyGrid, config: Config, sensor: Sensor, seed: int) -> None:
        self._grid, self._config, self._sensor, self._seed = grid, config, sensor, seed
        self._slow = self._fast = 0.0
        self._challenger: Belief | None = None
        self._began = 0.0
        self._lead = 0.0
        self.explained: float | None = None

    def observe(self, step: Step) -> None:
        """Take in what an update gave."""
        first = self.explained is None
        before = step.explained if self.explained is None else self.explained
        self.explained = before + RATE * (step.explained - before)
        slow, fast = self._config.recovery_alpha_slow, self._config.recovery_alpha_fast
        self._slow = step.mean_likelihood if first else self._slow + slow * (step.mean_likelihood - self._slow)
        self._fast = step.mean_likelihood if first else self._fast + fast * (step.mean_likelihood - self._fast)

    def review(
        self, belief: Belief, motion: OdometryMotion, reading: Reading, scan: int, time: float
    ) -> tuple[Belief, Verdict | None]:
        """The belief that goes on after this scan, which ``belief`` has been weighed by; and what there is to tell."""
        if self._config.recovery == "augmented":
            self._add_random(belief, scan)
        if self._config.recovery != "search" or self.explained is None:
            return belief, None
        if self._challenger is None:
            if self.explained < DOUBTFUL:
                self._call(reading, scan, time)
            return belief, None
        self._compare(self._challenger, belief, motion, reading, scan)
        return self._judge(self._challenger, belief, time)

    def _call(self, reading: Reading, scan: int, time: float) -> None:
        fewest = min(CHALLENGERS, self._config.max_particles)
        config = self._config.model_copy(update={"min_particles": max(fewest, self._config.min_particles)})
        challenger = Belief(self._grid, config, self._sensor, self._seed, STREAM, settled=False)
        key = stream_key(self._seed, scan, STREAM)
        challenger.particles.place(self._sensor.search(reading, self._config.max_particles, key).poses)
        self._challenger, self._began, self._lead = challenger, time, 0.0

    def _compare(self, challenger: Belief, belief: Belief, motion: OdometryMotion, reading: Reading, scan: int) -> None:
        """The challenger takes its turn, and the lead changes by what the scan says for each of the two."""
        patch = patches(motion)
        temper = reading.temper * patch
        challenger.resample(scan)
        challenger.predict(motion, scan)
        gained = challenger.weigh(reading, temper) - temper * belief.particles.mean_log_likelihood()
        self._lead += min(max(gained, -MOST_PER_PATCH * patch), MOST_PER_PATCH * patch)

    def _judge(self, challenger: Belief, belief: Belief, time: float) -> tuple[Belief, Verdict | None]:
        since = time - self._began
        if self._lead > MARGIN:
            self._challenger, self.explained = None, None
            return challenger, Verdict(self._lead, since)
        behind = self._lead < 0.0 and (self.explained or 0.0) > DOUBTFUL
        if behind or since > PATIENCE:
            self._challenger = None
        return belief, None

    def _add_random(self, belief: Belief, scan: int) -> None:
        share = min(0.99, max(0.0, 1.0 - self._fast / self._slow)) if self._slow > 0.0 else 0.0
        n = round(share * self._config.max_particles / 2)
        if n > 0:
            start = self._config.model_copy(update={"init": "free_space", "max_particles": n})
            key = stream_key(self._seed, scan, STREAM)
            belief.admit(initial_particles(self._grid, start, int(key)), share, key)
