"""Localize, look back, learn: the parameters that the logs themselves ask for, without any ground truth."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.filter.range_bias import RangeBias
from pipeline.localization import localize
from pipeline.logs.messages import Log, Scan
from pipeline.maps.walls import wall_half_thickness
from pipeline.motion.faults import without_leaps
from pipeline.tune.amcl import AmclFit, fit_amcl
from pipeline.tune.drift import DRIFTS, DriftFit, drift_windows, fit_drift
from pipeline.tune.em import LEARNED, Array, Fit, Readings, fit_beam_model
from pipeline.tune.found import Found
from pipeline.tune.motion import ALPHAS, FEWEST, fit_motion, windows
from pipeline.tune.own_model import fit_own_model, learnable
from pipeline.tune.reasons import Reason, explain
from pipeline.tune.scans import trusted, updates
from pipeline.tune.temper import independent_beams, window_likelihoods
from pipeline.tune.way import Listener
from pipeline.world.expected_ranges import select_beams

PARAMETERS = (*LEARNED, "occupied_threshold", "independent_beams", *ALPHAS, *DRIFTS)
THRESHOLDS = (0.35, 0.6, 0.8, 0.9, 0.97)
MOST_SCANS = 1000
"""Of one log, spread over it: 60,000 beams settle ten parameters."""
SEGMENT = 50
"""Scans that are learned from, or held out, together: neighbours see the same walls."""
HITS = 0.4
"""m: readings so close to the map's range start as hits."""


class Progress(Protocol):
    """Passes the scans on and shows how many of ``total`` have passed: ``console.progress``."""

    def __call__(self, items: Iterable[Scan], total: int, label: str) -> Iterator[Scan]:
        """Iterate lazily over the scans."""
        ...


@dataclass(frozen=True)
class Scores:
    """Of one configuration, on the scans it was learned from and on those held out.

    ``likelihood``: mean nats per beam; ``evidence``: mean nats per scan, all tempered alike.
    """

    likelihood: tuple[float, float]
    evidence: tuple[float, float]


@dataclass(frozen=True)
class Tuning:
    """What was learned: ``before`` and ``after``, whose range_bias is a number; and how good each of them is.

    ``before_scores`` and ``after_scores``: the latter of a model learned from one half of the scans only, so that
    the other half is held out; ``after`` itself is learned from all. ``thresholds``: (candidate, held-out evidence,
    nats per scan). ``history``: log-likelihood per beam over the iterations. ``readings``: per log, under ``after``.
    ``drift``: how hindsight differs from the laser's odometry. ``driven`` (w, 4): how from that of the wheels, as
    ``motion.windows`` has it. ``rivals``: per log, likelihoods of places, as ``temper.window_likelihoods`` has them.
    ``amcl``: the same for AMCL, which has other parameters. ``remarks``: what was not learned, and why.
    """

    logs: tuple[Log, ...]
    before: Config
    after: Config
    before_scores: Scores
    after_scores: Scores
    thresholds: tuple[tuple[float, float], ...]
    history: tuple[float, ...]
    scans: int
    beams: int
    readings: tuple[Readings, ...]
    drift: DriftFit
    driven: Array
    rivals: tuple[Array, ...]
    amcl: AmclFit
    remarks: tuple[str, ...]
    seed: int

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """From which numbers each value of ``after`` comes."""
        return explain(self)

    def to_dict(self) -> dict[str, Any]:
        """As plain values."""
        return {
            "logs": [{"name": log.name, "sha256": log.sha256} for log in self.logs],
            "seed": self.seed,
            "scans": self.scans,
            "beams": self.beams,
            "before": {name: getattr(self.before, name) for name in PARAMETERS} | self.before.own,
            "after": {name: getattr(self.after, name) for name in PARAMETERS} | self.after.own,
            "scores": {"before": vars(self.before_scores), "after": vars(self.after_scores)},
            "thresholds": [{"occupied_threshold": t, "evidence": e} for t, e in self.thresholds],
            "history": list(self.history),
            "remarks": list(self.remarks),
            "explain": [reason.to_dict() for reason in self.reasons],
            "amcl": {
                "parameters": dict(self.amcl.values),
                "explain": [reason.to_dict() for reason in self.amcl.reasons],
            },
        }


def tune(
    logs: Sequence[Log], config: Config, *, seed: int = 0, rounds: int = 1, progress: Progress | None = None
) -> Tuning:
    """Learn PARAMETERS from logs of one building and robot; ``rounds`` > 1 localizes again with what was learned.

    Raises MclError for a log without a map, or on which the filter does not converge.
    """
    if not config.hindsight:
        raise MclError("tuning learns from hindsight", "use --set hindsight=true")
    start = config
    found = [_find(log, config, seed, progress) for log in logs]
    learned = _learn(found, config)
    for _ in range(rounds - 1):
        found = [_find(log, learned.config, seed, progress) for log in logs]
        learned = _learn(found, learned.config)
    before = start.model_copy(update={"range_bias": _initial_bias(found, start)})
    scans = [f.every(MOST_SCANS) for f in found]
    after = Config.model_validate(learned.config.model_dump())
    final = tuple(f.readings(s, after) for f, s in zip(found, scans, strict=True))
    return Tuning(
        logs=tuple(logs),
        before=before,
        after=after,
        before_scores=_scores(found, before, before),
        after_scores=_scores(found, learned.half, before),
        thresholds=learned.thresholds,
        history=learned.history,
        scans=sum(map(len, scans)),
        beams=sum(int(np.count_nonzero(~np.isnan(r.measured))) for r in final),
        readings=final,
        drift=learned.drift,
        driven=learned.driven,
        rivals=learned.rivals,
        amcl=fit_amcl(found, after),
        remarks=learned.remarks,
        seed=seed,
    )


@dataclass(frozen=True)
class _Learned:
    config: Config
    half: Config
    thresholds: tuple[tuple[float, float], ...]
    history: tuple[float, ...]
    drift: DriftFit
    driven: Array
    rivals: tuple[Array, ...]
    remarks: tuple[str, ...]


def _find(log: Log, config: Config, seed: int, progress: Progress | None) -> Found:
    def watched(scans: Iterable[Scan]) -> Iterable[Scan]:
        return scans if progress is None else progress(scans, len(log), f"localizing {log.name}")

    listener = Listener()
    result = localize(log, config, seed=seed, sinks=[listener], progress=watched)
    way = listener.way
    every = updates(way.poses, config)
    scans = trusted(log, result, every)
    assert result.hindsight is not None
    heard = replace(log, odometry=without_leaps(log.times, log.odometry), ranges=way.ranges)
    return Found(heard, way, result.hindsight, every, scans)


def _learn(found: Sequence[Found], config: Config) -> _Learned:
    """The threshold whose model, learned from every other segment, best predicts the rest; then all, from all scans."""
    temper = _temper(found, config)
    tried: list[tuple[float, float, Config]] = []
    present = {f.log.grid.wall_threshold(config.occupied_threshold) for f in found if f.log.grid is not None}
    for threshold in sorted({*THRESHOLDS, *present}):
        half = _fitted(found, config.model_copy(update={"occupied_threshold": threshold}))
        rest = [f.evidence(_half(f, held_out=True), half, temper) for f in found]
        tried.append((float(np.concatenate(rest).mean()), threshold, half))
    half = max(tried, key=lambda each: each[0])[2]
    fit = _fit([f.readings(f.every(MOST_SCANS), half) for f in found], half)
    driven = [windows(f.log.odometry, f.trajectory, f.scans, config) for f in found if f.way.wheels]
    drift = fit_drift([drift_windows(f.way, f.trajectory, f.updates, f.scans) for f in found], fit.config)
    learned = fit_motion(driven, drift.config)
    rivals = [window_likelihoods(f.log, f.way.poses, f.trajectory[f.scans], f.scans, learned) for f in found]
    beams = round(np.mean([len(select_beams(f.log.laser, config)) for f in found]))
    learned = learned.model_copy(update={"independent_beams": independent_beams(rivals, beams)})
    thresholds = tuple((threshold, value) for value, threshold, _ in tried)
    rows = np.concatenate([np.empty((0, 4)), *driven])
    remarks = _remarks(found, driven, drift)
    return _Learned(learned, half, thresholds, fit.history, drift, rows, tuple(rivals), remarks)


def _remarks(found: Sequence[Found], driven: Sequence[Array], drift: DriftFit) -> tuple[str, ...]:
    """What of the motion was left as it was."""
    said = []
    if sum(map(len, driven)) < FEWEST:
        why = "the robot moved too little" if driven else "no wheels were heard"
        said.append(f"{ALPHAS[0]} to {ALPHAS[-1]} are as they were: {why}")
    unknown = [name for name, jitter in zip(DRIFTS, drift.jitter, strict=True) if np.isnan(jitter)]
    if unknown:
        heard = any(f.way.laser is not None for f in found)
        why = "too little was driven that the laser holds" if heard else "the laser's odometry was not heard"
        said.append(f"{' and '.join(unknown)} {'are' if len(unknown) > 1 else 'is'} as they were: {why}")
    return tuple(said)


def _fitted(found: Sequence[Found], config: Config) -> Config:
    """The beam model of the half that is learned from."""
    parts = [f.readings(_half(f, held_out=False), config) for f in found]
    near = np.concatenate([r.residuals() for r in parts])
    near = near[np.abs(near) < HITS]
    bias = float(np.median(near)) if len(near) else 0.0
    return _fit(parts, config.model_copy(update={"range_bias": bias})).config


def _fit(readings: Sequence[Readings], config: Config) -> Fit:
    """The beam model, the user's own if there is one."""
    return fit_own_model(readings, config) if learnable(config) else fit_beam_model(readings, config)


def _half(found: Found, *, held_out: bool) -> NDArray[np.int64]:
    """Every other segment of the scans that are used."""
    segment = np.arange(len(found.scans)) // min(SEGMENT, len(found.scans) // 4)  # of a short log too there is a rest
    chosen = found.scans[segment % 2 == int(held_out)]
    return chosen[:: max(1, -(-2 * len(chosen) // MOST_SCANS))]


def _scores(found: Sequence[Found], config: Config, start: Config) -> Scores:
    """Of a configuration whose range_bias is a number; the temper is the start's, so that evidences compare."""
    temper = _temper(found, start)
    likelihood, nats = [], []
    for held_out in (False, True):
        parts = [f.readings(_half(f, held_out=held_out), config) for f in found]
        valid = sum(int(np.count_nonzero(~np.isnan(r.measured))) for r in parts)
        likelihood.append(sum(float(r.log_likelihood(config).sum()) for r in parts) / max(valid, 1))
        each = [f.evidence(_half(f, held_out=held_out), config, temper) for f in found]
        nats.append(float(np.concatenate(each).mean()))
    return Scores((likelihood[0], likelihood[1]), (nats[0], nats[1]))


def _temper(found: Sequence[Found], config: Config) -> float:
    beams = max(len(select_beams(f.log.laser, config)) for f in found)
    return min(1.0, (config.independent_beams or beams) / beams)


def _initial_bias(found: Sequence[Found], config: Config) -> float:
    """Where the filter's own bias starts, over the logs' maps."""
    biases = []
    for f in found:
        assert f.log.grid is not None
        half_thickness = wall_half_thickness(f.log.grid, f.log.grid.wall_threshold(config.occupied_threshold))
        biases.append(RangeBias(config, half_thickness).value)
    return float(np.mean(biases))
