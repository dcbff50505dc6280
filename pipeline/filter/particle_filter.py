"""Monte Carlo localization (Probabilistic Robotics, Tables 8.2 to 8.4): predict, weigh, resample, and doubt."""

from __future__ import annotations

import dataclasses
import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.filter.belief import Belief
from pipeline.filter.dual import place_after, proposed
from pipeline.filter.estimate import map_estimate
from pipeline.filter.hindsight import Hindsight
from pipeline.filter.initialization import initial_particles
from pipeline.filter.narrator import Narrator
from pipeline.filter.recovery import MARGIN, Recovery, Takeover
from pipeline.filter.sensor import Reading, Sensor, contradicting_shares, explained_share
from pipeline.filter.step import Estimate, Step
from pipeline.filter.substeps import SubSteps
from pipeline.geometry import between, compose
from pipeline.judgement.verdict import OFF, Judge, Signs
from pipeline.kernels.belief import to_map
from pipeline.kernels.clusters import MOST as MOST_CLUSTERS
from pipeline.kernels.random import stream_key
from pipeline.logs.messages import Laser, Scan
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.motion.models import Component, motion_model
from pipeline.motion.prior import Prior, motion_prior
from pipeline.motion.witnesses import Motion, Witnesses
from pipeline.world.memory import KeyScan, Memory
from pipeline.world.seen import Seen

Scalar = TypeVar("Scalar", bound=np.generic)

INITIAL, REMEMBER, DUAL = 0, 8, 24
"""Purposes of random numbers: each has its own stream at every scan."""
FAR = 0.3
"""m: deviation of a drive that nobody saw, from which on the scan proposes places: particles would be too few."""
STILL = 5.0
"""How many times as far a robot must have moved that its wheels say stands still."""
NOTABLE = 0.01
"""Probability from which on a rival is shown among the hypotheses."""
TRUSTED = 0.9
"""Weight of a hypothesis from which on its residuals may teach the range bias."""


class ParticleFilter:
    """The belief as weighted particles, updated by one scan at a time.

    The same grid, laser, config, seed and scans give the same steps, whatever the number of threads.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        laser: Laser,
        config: Config,
        seed: int = 0,
        *,
        wheels: bool = True,
        seen: Seen | None = None,
    ) -> None:
        self._grid, self._laser, self._config, self._seed = grid, laser, config, seed
        self._sensor = Sensor(grid, laser, config)
        self._belief = Belief(grid, config, self._sensor, seed)
        self._recovery = Recovery(grid, config, self._sensor, seed)
        self._judge = Judge()
        self._narrator = Narrator()
        self._map_poses = np.empty((config.max_particles, 3), np.float32)
        self._witnesses = Witnesses(laser, config, wheels)
        self._motion_model = motion_model(config)
        self._motion: Motion | None = None
        self._memory: Memory | None = None
        self._shown = 0
        self._off, self._turned = 0.0, False
        if self._sensor.world is not None and "memory" not in config.without:
            self._memory = Memory(self._sensor.world, laser, seen)
        self.hindsight = Hindsight(grid, config)

    def watch(self, substeps: SubSteps) -> None:
        """From now on tell of what happens within an update. Raises MclError for a belief that draws no particles."""
        if not isinstance(self._belief, Belief):
            raise MclError("sub-steps are those of particles, and this filter has none", "set filter=mcl")
        self._belief.watcher = substeps

    def finish(self) -> Seen | None:
        """The log is over: what it has shown of the world, by itself; None if nothing is remembered."""
        if self._memory is None:
            return None
        self._memory.close()
        return self._memory.seen

    def update(self, scan: Scan) -> Step:
        """Let one scan change the belief; a robot that stands still teaches nothing new, so nothing changes then."""
        if len(scan.ranges) != self._laser.beams:
            raise MclError(f"scan {scan.index} has {len(scan.ranges)} ranges, the laser {self._laser.beams} beams")
        motion = self._witnesses.update(scan)
        self.hindsight.follow(motion)
        reading = self._sensor.read(motion.ranges)
        if self._memory is not None and motion.unseen is not None:
            self._memory.close()
        prior, resampled, takeover = None, False, None
        if moved := self._moved(motion):
            if self._motion is None:
                self._start(scan, reading)
            else:
                prior = motion_prior(self._motion, motion, self._config, self._motion_model)
                if self._off > OFF:
                    prior = prior.exactly
                resampled, takeover = self._advance(scan, reading, motion, prior)
            self._motion = motion
        step = self._step(scan, reading, motion, prior, moved, resampled, takeover)
        if moved:
            self._learn(step)
            self._remember(step, takeover)
        return self._narrator.tell(step, takeover)

    def _moved(self, motion: Motion) -> bool:
        if self._motion is None or motion.unseen is not None:
            return True
        far, turned = self._config.update_min_d, self._config.update_min_a
        if motion.laser is None or motion.odometry is None or self._motion.odometry is None:
            return _reaches(between(self._motion.pose, motion.pose), far, turned)
        if motion.unheard != self._motion.unheard:
            return _reaches(between(self._motion.pose, motion.pose), far, turned)
        # A laser among people is never quite still: against wheels that are, its word counts from farther on.
        if _reaches(between(self._motion.odometry, motion.odometry), far, turned):
            return True
        return _reaches(between(self._motion.pose, motion.pose), STILL * far, STILL * turned)

    def _start(self, scan: Scan, reading: Reading) -> None:
        """Particles where config.init says; an exhaustive start has to see the first scan for that."""
        key = stream_key(self._seed, 0, INITIAL)
        if self._config.init == "exhaustive":
            poses = self._sensor.search(reading, self._config.max_particles, key).poses
            self._recovery.start(poses, scan)
        else:
            poses = initial_particles(self._grid, self._config, int(key))
        self._belief.particles.place(poses)
        self._belief.weigh(reading)
        if self._belief.watcher is not None:
            self._belief.watcher.weighed(scan.index, self._belief.particles, self._belief.hypotheses[0])

    def _advance(self, scan: Scan, reading: Reading, motion: Motion, prior: Prior) -> tuple[bool, Takeover | None]:
        """One turn of the belief, and of whoever challenges it; returns whether it resampled, and what recovery did."""
        resampled = self._belief.resample(scan.index, motion.unseen is not None)
        unseen = prior.unseen
        proposes = self._sensor.searches and "proposals" not in self._config.without
        if unseen is None or unseen.reach < FAR or not proposes:
            self._belief.advance(prior, reading, scan.index)
        else:
            self._advance_unseen(prior, unseen, reading, scan.index)
        return resampled, self._recovery.review(self._belief, motion, prior, reading, scan)

    def _advance_unseen(self, prior: Prior, unseen: Component, reading: Reading, scan: int) -> None:
        """A turn after which the robot may be metres away: too far for particles that go there at random to find it."""
        belief, key = self._belief, stream_key(self._seed, scan, DUAL)
        before = place_after(self._grid, belief.particles, unseen.reach)
        n = min(belief.particles.n, self._config.max_particles // 2)
        found, evidence = proposed(self._grid, self._sensor, before, reading, n, key)
        rest = 1.0 - unseen.share
        told = prior.without(unseen)
        others = belief.advance(told, reading, scan) + math.log(max(rest, 1e-3))
        evidence += math.log(unseen.share)
        share = min(1.0 / (1.0 + math.exp(min(others - evidence, 500.0))), 0.999)
        belief.admit(found.poses, share, key)
        if len(told.components) < len(prior.components):
            belief.followed = np.append((1.0 - share) * belief.followed, share)

    def _learn(self, step: Step) -> None:
        if step.estimate.weight > TRUSTED:
            self._sensor.bias.learn(step.beams.measured, step.beams.expected)
        self._recovery.observe(step)
        key = stream_key(self._seed, step.index, REMEMBER)
        recovery = self._recovery
        self.hindsight.remember(step, self._belief.particles, recovery.rivals, recovery.odds(MARGIN), key)

    def _remember(self, step: Step, takeover: Takeover | None) -> None:
        laser = step.motion.laser
        if self._memory is None or laser is None:
            return
        if takeover is not None:
            self._memory.moved()
        believed = self._grid.to_grid(step.estimate.pose)
        seen = step.motion.ranges - np.float32(self._sensor.bias.value)
        seen[np.isinf(seen)] = np.nan  # it may have met glass
        scan = KeyScan(step.time, laser.stretch, laser.pose, seen, believed)
        self._memory.follow(scan, step.estimate.weight > TRUSTED)

    def _step(
        self,
        scan: Scan,
        reading: Reading,
        motion: Motion,
        prior: Prior | None,
        moved: bool,
        resampled: bool,
        takeover: Takeover | None,
    ) -> Step:
        p, best = self._belief.particles, self._belief.hypotheses[0]
        # While the robot (nearly) stands still, the estimate follows the witnesses, as the next prediction will.
        drift = between(self._motion.pose, motion.pose)  # type: ignore[union-attr]
        odds = self._recovery.odds()
        estimate = Estimate(compose(best.pose, drift), best.covariance, float(odds[0]) * best.weight)
        at_x, at_y, _ = self._grid.to_grid(estimate.pose)
        beams = self._sensor.beams_at(estimate.pose, reading)
        short, through = contradicting_shares(beams)
        self._off = off = self._sensor.off_map(p.poses, p.weights)
        clusters = self._clusters(estimate, odds)
        places = tuple(cluster.weight for cluster in clusters)
        changed = motion.unseen is not None or takeover is not None
        self._turned |= any(fault.kind == "turned" for fault in motion.faults)
        signs = Signs(scan.time, estimate.weight, beams.worth, off, places, changed, self._turned)
        to_map(3 * p.n, *p.poses, *self._grid.origin, self._map_poses)
        return Step(
            index=scan.index,
            stamp=scan.stamp,
            time=scan.time,
            particles=_read_only(self._map_poses[: p.n]),
            log_weights=_read_only(p.log_weights),
            estimate=estimate,
            clusters=clusters,
            beams=beams,
            ess=p.ess,
            mean_likelihood=math.exp(p.mean_log_likelihood() / reading.valid),
            explained=explained_share(beams),
            spread=p.spread(at_x, at_y),
            moved=moved,
            resampled=resampled,
            motion=motion,
            verdict=self._judge.judge(signs),
            short=short,
            through=through,
            off_map=off,
            prior=prior,
            changed=self._changed(),
            followed=None if prior is None else self._belief.followed,
            walls=None if motion.laser is None else _read_only(self._witnesses.walls),
            heat=self._sensor.heat(),
        )

    def _changed(self) -> NDArray[np.float32] | None:
        """Where the world is not as mapped, if another part of it is known to be so than at the step before."""
        world = self._sensor.world
        if self._memory is None or world is None or world.version == self._shown:
            return None
        self._shown = world.version
        kinds = world.changed
        row, col = np.nonzero(kinds)
        at = np.stack([col + 0.5 - world.margin, row + 0.5 - world.margin, np.zeros(len(row))], axis=1)
        places = self._grid.to_map(at * self._grid.resolution)
        places[:, 2] = kinds[row, col]
        return places.astype(np.float32)

    def _clusters(self, estimate: Estimate, odds: NDArray[np.float64]) -> tuple[Estimate, ...]:
        """The estimate, and after it the belief's other hypotheses and its rivals, heaviest first."""
        others = [dataclasses.replace(h, weight=float(odds[0]) * h.weight) for h in self._belief.hypotheses[1:]]
        rivals = self._recovery.rivals
        for row in np.flatnonzero(odds[1:] > NOTABLE):
            pose, covariance = rivals.poses[row], rivals.covariance(int(row))
            others.append(map_estimate(self._grid, pose, covariance, float(odds[1 + row])))
        return (estimate, *sorted(others, key=lambda e: -e.weight)[: MOST_CLUSTERS - 1])


def _reaches(step: NDArray[np.float64], far: float, turned: float) -> bool:
    return math.hypot(step[0], step[1]) >= far or abs(float(step[2])) >= turned


def _read_only(array: NDArray[Scalar]) -> NDArray[Scalar]:
    view = array.view()
    view.flags.writeable = False
    return view
