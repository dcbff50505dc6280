"""A single run held against the truth: what ``localize`` found, and where the robot was."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pipeline.errors import MclError
from pipeline.evaluate.metrics import Array, Score, interpolate, known, pose_errors, score
from pipeline.evaluate.runs import kidnapped_in
from pipeline.filter.step import TAKEOVERS
from pipeline.logs.messages import Trajectory

if TYPE_CHECKING:
    from pipeline.localization import RunResult


def score_run(result: RunResult, reference: Trajectory | None = None, *, kidnapped_at: Sequence[float] = ()) -> Score:
    """Score a run against a reference of base_link in the map frame, or the log's own truth.

    ``kidnapped_at``: seconds since the first scan at which the robot, carried off, measures again; the log's own note
    if none is given. Raises MclError where the truth is not known, and as ``metrics.score``.
    """
    return score(
        result.times,
        result.poses,
        _truth(result, reference),
        kidnapped_at=tuple(kidnapped_at) or kidnapped_in(result.log.metadata),
        lost_at=[index for index, _, event in result.events if event.kind in TAKEOVERS],
        hindsight=result.hindsight,
        weights=result.weights,
    )


def run_errors(result: RunResult, reference: Trajectory | None = None) -> tuple[Array, Array]:
    """Distance from the truth in m, and of the headings in rad, (n,) each, of every scan; NaN where it is not known.

    Raises MclError where it is known at no scan.
    """
    return pose_errors(result.poses, _truth(result, reference))


def _truth(result: RunResult, reference: Trajectory | None) -> Array:
    reference = result.log.ground_truth if reference is None else reference
    if reference is None:
        raise MclError("this log does not know the truth", "give a reference", path=result.log.path)
    truth = interpolate(reference, result.stamps)
    if not known(truth).any():
        raise MclError("the reference covers none of the scans", path=result.log.path)
    return truth
