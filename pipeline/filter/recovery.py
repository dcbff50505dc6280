"""Noticing that the robot is lost, and finding it again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.filter.belief import Belief
from pipeline.filter.initialization import initial_particles
from pipeline.filter.rivals import Rivals, same_place
from pipeline.filter.sensor import Reading, Sensor
from pipeline.filter.step import Step
from pipeline.judgement.evidence import Evidence
from pipeline.kernels.random import stream_key
from pipeline.logs.messages import Scan
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.motion.prior import Prior
from pipeline.motion.witnesses import Motion

RATE = 0.1
"""Share of a new scan in what is smoothed of the beams: about ten updates of memory."""
DOUBTFUL = 1.0
"""Nats a beam: if the belief explains the scans no better than that against what this laser reads on average, rivals
are looked for. Right poses explain 0.5 to 0.95 of the beams, and outdoors fewer: no share of them tells.
"""
RESPITE = 10.0
"""Seconds from one search to the next."""
MOST_RIVALS = 24
"""How many are followed at a time. Those far behind soon go."""
DRAWS = 20_000
"""Poses drawn from a search, among which the rivals are the densest."""
MARGIN = 10.5
"""Nats: a rival takes the belief's place when its lead over the belief and its lead over every other rival add up
to this. Where the map is wrong many rivals are ahead of a right belief, by up to 7, but none
stands out."""
CARRIED = 1.0
"""The same where nobody saw the way here and the wheels stood still: then hardly anything speaks for the belief."""
OPEN = 4.0
"""The same of a place that the belief has met in the contest by which it came where it is."""
BEATEN = 0.5 * MARGIN
"""Nats behind the belief at which such a place has lost, and is no likelier than any other."""
HOPELESS = 12.0
"""Nats behind the best contender at which a rival is given up."""
SETTLED = 0.9
"""Weight of the best hypothesis from which on the belief is at one place."""
STREAM = 16
"""The first of the purposes of random numbers that belong to the recovery."""


@dataclass(frozen=True)
class Takeover:
    """A rival took the belief's place: ``lead`` nats ahead, followed for ``since`` seconds, ``distance`` m away from
    the belief, which explained this smoothed share of the beams."""

    lead: float
    since: float
    distance: float
    explained: float


class Recovery:
    """Watches the belief, in the way that ``config.recovery`` names.

    ``search``: rivals from an exhaustive search of the building, at the start and whenever few beams are explained, are
    followed beside the belief until the evidence has decided. One that is clearly ahead takes the belief's
    place, and the belief becomes a rival: no decision is final.
    ``augmented``: random newcomers as w_slow and w_fast ask for them (Table 8.3).
    """

    def __init__(self, grid: OccupancyGrid, config: Config, sensor: Sensor, seed: int) -> None:
        self._grid, self._config, self._sensor, self._seed = grid, config, sensor, seed
        self._slow = self._fast = 0.0
        self._explained: float | None = None
        self._worth: float | None = None
        self.rivals = Rivals(sensor, seed, STREAM + 2)
        self._evidence = Evidence()
        self._searched = 0.0

    def odds(self, against: float | None = None) -> NDArray[np.float64]:
        """(1 + rivals,) probabilities of the belief and of each rival, if one of them is right.

        A robot is seldom carried off: the odds of that are ``against`` nats. By default a lone rival is as likely as
        the belief when it is about to take its place.
        """
        leads = self._evidence.leads().copy()
        leads[1:] -= 0.5 * self.rivals.margin if against is None else against
        likely: NDArray[np.float64] = np.exp(leads - leads.max())
        return likely / likely.sum()

    def start(self, poses: NDArray[np.float32], scan: Scan) -> None:
        """Follow also the places that the search for the start found: ``poses`` (3, n) in the grid frame."""
        if self._config.recovery == "search":
            self._add(poses, np.empty((0, 3)), scan, MARGIN)

    def observe(self, step: Step) -> None:
        """Take in what an update gave."""
        first = self._explained is None
        before = step.explained if self._explained is None else self._explained
        worth = step.beams.worth
        self._worth = worth if self._worth is None else self._worth + RATE * (worth - self._worth)
        self._explained = before + RATE * (step.explained - before)
        slow, fast = self._config.recovery_alpha_slow, self._config.recovery_alpha_fast
        self._slow = step.mean_likelihood if first else self._slow + slow * (step.mean_likelihood - self._slow)
        self._fast = step.mean_likelihood if first else self._fast + fast * (step.mean_likelihood - self._fast)

    def review(self, belief: Belief, motion: Motion, prior: Prior, reading: Reading, scan: Scan) -> Takeover | None:
        """Let the rivals take their turn after the belief has taken its own; returns the takeover, if one fell."""
        if self._config.recovery == "augmented":
            self._add_random(belief, scan.index)
        if self._config.recovery != "search":
            return None
        self.rivals.follow(prior, reading, scan.index)
        carried = motion.unseen is not None and not motion.unseen.driven
        if carried:
            self.rivals.margin[:] = CARRIED
        if motion.unseen is not None or self._doubtful(scan):
            key = stream_key(self._seed, scan.index, STREAM)
            found = self._sensor.search(reading, DRAWS, key, coarse=True).poses
            self._add(found, self._place(belief)[None], scan, CARRIED if carried else MARGIN)
        if not len(self.rivals):
            return None
        self._hear(belief, reading, motion)
        takeover = self._decide(belief, scan)
        self._dismiss(belief)
        return takeover

    def _doubtful(self, scan: Scan) -> bool:
        return self._worth is not None and self._worth < DOUBTFUL and scan.time - self._searched >= RESPITE

    def _add(self, draws: NDArray[np.float32], taken: NDArray[np.float64], scan: Scan, margin: float) -> None:
        """Half of the places are for newcomers; the best of those that were followed keep the rest."""
        self._keep(1 + np.argsort(-self._evidence.leads()[1:], kind="stable")[: MOST_RIVALS // 2])
        self._evidence.admit(self.rivals.find(draws, taken, MOST_RIVALS - len(self.rivals), scan.time, margin))
        self._searched = scan.time

    def _place(self, belief: Belief) -> NDArray[np.float64]:
        return self._grid.to_grid(belief.hypotheses[0].pose)

    def _hear(self, belief: Belief, reading: Reading, motion: Motion) -> None:
        poses = np.vstack([self._place(belief), self.rivals.poses])
        statement, weight = self._sensor.statement(poses, reading, np.append(True, self.rivals.roams))
        # Spots are told apart as the wheels reckon, where there are any: good enough for the length of a contest. With
        # the laser's reckoning a robot that was carried off was found later (docs/motion.md).
        at = motion.pose if motion.odometry is None else motion.odometry
        self._evidence.enter(statement, self._sensor.ends(at, reading), at[:2], weight)

    def _decide(self, belief: Belief, scan: Scan) -> Takeover | None:
        leads, rivals = self._evidence.leads(), self.rivals
        rivals.margin[leads[1:] < -BEATEN] = MARGIN
        second, best = np.argsort(leads, kind="stable")[-2:]
        winner = best - 1
        if best == 0 or 2.0 * leads[best] - leads[second] < rivals.margin[winner]:
            return None
        away = np.hypot(*(rivals.poses[winner] - self._place(belief))[:2])
        since, explained = scan.time - float(rivals.began[winner]), self._explained or 0.0
        place = rivals.particles[:, winner].copy(), rivals.weights[winner].copy()
        others = np.delete(np.arange(len(rivals)), winner)
        rivals.keep(others)
        # The new belief has yet to win against these: it was none when they met.
        rivals.margin[:] = OPEN
        rivals.adopt(belief.particles.poses, belief.particles.weights, scan.time, scan.index, OPEN)
        self._evidence.keep(np.array([best, *(others + 1), 0]))
        belief.move(*place, stream_key(self._seed, scan.index, STREAM + 1))
        self._explained = self._worth = None
        return Takeover(float(leads[best]), since, float(away), explained)

    def _dismiss(self, belief: Belief) -> None:
        """Rivals go that are far behind, or at the place of a better one; when none is left, the contest is over."""
        leads, poses = self._evidence.leads(), np.vstack([self._place(belief), self.rivals.poses])
        # Lists: numpy would take longer to look at one of these than to work all of them out.
        same = same_place(poses[:, None], poses[None]).tolist()
        settled = belief.hypotheses[0].weight > SETTLED
        belief_row, kept, least = 0, list[int](), leads.max() - HOPELESS
        for row in (np.argsort(-leads[1:], kind="stable") + 1).tolist():
            if leads[row] < least or any(same[row][other] for other in kept):
                continue
            if settled and same[row][0]:
                # Where the belief and a rival meet they are one, with the better account of the way there.
                belief_row = row if leads[row] > leads[belief_row] else belief_row
                continue
            kept.append(row)
        self._keep(np.array(kept, np.int64), belief_row)
        if not kept:
            self._evidence = Evidence()

    def _keep(self, rows: NDArray[np.int64], belief_row: int = 0) -> None:
        """Of the contenders only these rivals stay, and the belief with the account ``belief_row``."""
        if belief_row == 0 and np.array_equal(rows, np.arange(1, 1 + len(self.rivals))):
            return
        self.rivals.keep(rows - 1)
        self._evidence.keep(np.append(belief_row, rows))

    def _add_random(self, belief: Belief, scan: int) -> None:
        share = min(0.99, max(0.0, 1.0 - self._fast / self._slow)) if self._slow > 0.0 else 0.0
        n = round(share * self._config.max_particles / 2)
        if n > 0:
            start = self._config.model_copy(update={"init": "free_space", "max_particles": n})
            key = stream_key(self._seed, scan, STREAM)
            belief.admit(initial_particles(self._grid, start, int(key)), share, key)
