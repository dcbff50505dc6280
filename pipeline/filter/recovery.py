"""Noticing that the robot is lost, and finding it again."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.filter.beam_model import BeamModel
from pipeline.filter.expected_ranges import ExpectedRanges
from pipeline.filter.initialization import initial_particles
from pipeline.filter.particles import Particles
from pipeline.filter.resampling import draw_ancestors
from pipeline.filter.step import Step
from pipeline.geometry import between, compose
from pipeline.maps.occupancy_grid import OccupancyGrid

RATE = 0.1
"""Share of a new scan in the smoothed share of explained beams: about ten updates of memory."""
DOUBTFUL = 0.6
"""Below this smoothed share the building is searched. Right poses explain 0.5 to 0.95 of the beams: people, open doors
and rooms that the map lacks take the rest. So doubt is cheap and frequent; only a search decides."""
SEARCH_EVERY = 1.0
"""Seconds of the log between two searches."""
FRAMES = 14
FRAME_D = 0.25
FRAME_A = 0.25
"""m, rad between two of the scans that are remembered for the search: nearer ones would say the same again."""
MOST_PER_SCAN = 5.0
"""Nats that one scan may count for or against a rival: a crowd, or a door that the map lacks, can spoil any scan."""
MARGIN = 36.0
"""Nats, all remembered scans together, from which on rivals are heard. Where the map is wrong, it is wrong for
metres, so the scans are far from independent: at right poses elsewhere has led by up to 26 nats, at wrong ones it leads
by 50 and more after 3 m."""
SHARE = 0.5
"""Of the weight goes to the rivals, the rest stays with the belief: the scans to come decide between them."""
CANDIDATES = 20_000
RIVALS = 1000


@dataclass(frozen=True)
class Frame:
    """A scan remembered: its log-likelihood rows, what it weighs, where the odometry was, how well the belief did."""

    rows: NDArray[np.float32]
    outside: float
    temper: float
    odometry: NDArray[np.float64]
    log_likelihood: float


@dataclass(frozen=True)
class Rivals:
    """Poses (3, m) float32, grid frame, that challenge the belief, with their share of the weight.

    ``scans``: how many of the latest scans they explain better; ``lead``: by how many nats, all scans together.
    """

    poses: NDArray[np.float32]
    share: float
    scans: int
    lead: float


class Recovery:
    """Watches the belief, in the way that ``config.recovery`` names.

    ``search``: when few beams are explained, every pose of the building is scored against the latest scan, the best are
    carried back along the odometry and scored against the scans before, and the evidence that the robot is *somewhere*
    else, averaged over all places, is set against the belief's own record over the same scans. If it leads by
    MARGIN, the best candidates are admitted as rivals.
    ``augmented``: random poses as w_slow and w_fast ask for them (Table 8.3).
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        config: Config,
        model: BeamModel,
        expected: ExpectedRanges,
        allowed: NDArray[np.bool_],
    ) -> None:
        self._grid, self._config, self._model, self._expected, self._allowed = grid, config, model, expected, allowed
        self._frames: deque[Frame] = deque(maxlen=FRAMES)
        self._searched = -math.inf
        self._slow = self._fast = 0.0
        self.explained: float | None = None

    def observe(self, step: Step) -> None:
        """Take in what an update gave."""
        first = self.explained is None
        before = step.explained if self.explained is None else self.explained
        self.explained = before + RATE * (step.explained - before)
        slow, fast = self._config.recovery_alpha_slow, self._config.recovery_alpha_fast
        self._slow = step.mean_likelihood if first else self._slow + slow * (step.mean_likelihood - self._slow)
        self._fast = step.mean_likelihood if first else self._fast + fast * (step.mean_likelihood - self._fast)

    def rivals(
        self,
        particles: Particles,
        ranges: NDArray[np.float32],
        odometry: NDArray[np.float64],
        time: float,
        key: np.uint64,
    ) -> Rivals | None:
        """Poses to admit beside the particles, which have just been weighed by ``ranges``; None if all is well."""
        if self._config.recovery == "augmented":
            return self._random(key)
        if self._config.recovery == "none" or self.explained is None:
            return None
        rows, outside = self._model.scan_rows(ranges), self._model.outside(ranges)
        frame = Frame(rows, outside, self._model.temper(ranges), odometry, particles.mean_log_likelihood())
        found = None
        if self.explained < DOUBTFUL and time >= self._searched + SEARCH_EVERY:
            self._searched = time
            found = self._search(frame, key)
        if not self._frames or self._far(self._frames[-1].odometry, odometry):
            self._frames.append(frame)
        return found

    def _far(self, before: NDArray[np.float64], now: NDArray[np.float64]) -> bool:
        dx, dy, turn = between(before, now)
        return math.hypot(dx, dy) >= FRAME_D or abs(turn) >= FRAME_A

    def _random(self, key: np.uint64) -> Rivals | None:
        share = min(0.99, max(0.0, 1.0 - self._fast / self._slow)) if self._slow > 0.0 else 0.0
        n = round(share * self._config.max_particles / 2)
        if n == 0:
            return None
        start = self._config.model_copy(update={"init": "free_space", "max_particles": n})
        return Rivals(initial_particles(self._grid, start, int(key)), share, 0, 0.0)

    def _search(self, now: Frame, key: np.uint64) -> Rivals | None:
        """Candidates from the latest scan; then back through the scans before it, as far as that favours them most."""
        drawn = self._expected.posterior(now.rows, self._model.config.independent_beams, self._allowed, CANDIDATES, key)
        gained, score = np.zeros(CANDIDATES), np.empty(CANDIDATES, np.float32)
        lead, best, scans = -math.inf, gained, 0
        # The candidates were drawn by the latest scan: what it says for them stands in their evidence.
        prior = drawn.log_evidence - now.temper * now.log_likelihood
        for k, frame in enumerate(reversed(self._frames), start=2):
            back = between(now.odometry, frame.odometry)
            then = np.ascontiguousarray(compose(drawn.poses.T, back).T.astype(np.float32))
            self._expected.score(then, frame.rows, frame.outside, score)
            ahead = frame.temper * (score - frame.log_likelihood)
            gained = gained + np.clip(ahead, -MOST_PER_SCAN, MOST_PER_SCAN)
            top = float(gained.max())
            total = min(prior, MOST_PER_SCAN) + top + math.log(float(np.exp(gained - top).mean()))
            if total > lead:
                lead, best, scans = total, gained, k
        if lead < MARGIN:
            return None
        weights = np.exp(best - best.max())
        chosen = draw_ancestors(weights / weights.sum(), RIVALS, "low_variance", key)
        return Rivals(drawn.poses[:, chosen], SHARE, scans, lead)
