"""What was learned, as a file that ``--config`` takes and as a table."""

from __future__ import annotations

from typing import Any

from pipeline.config import Config
from pipeline.tune.learning import PARAMETERS, Tuning

OF_THE_RUN = ("init", "initial_pose", "initial_pose_std", "hindsight", "record_particles")
"""What belongs to how the logs were run, not to the robot and its building."""
COLUMNS = ("", "before", "after")


def preset(tuning: Tuning) -> str:
    """YAML: a comment that says where it comes from; what was learned; what the starting configuration had of its own.

    Four digits: more than the logs can tell.
    """
    kept = {
        name: value
        for name, value in tuning.after.model_dump(mode="json").items()
        if name not in PARAMETERS and name not in OF_THE_RUN and value != _default(name)
    }
    before, after = tuning.before_scores, tuning.after_scores
    lines = [
        *(f"# {line}" for line in origin(tuning).splitlines()),
        f"# Held-out log-evidence, nats per scan: {before.evidence[1]:.3f} before, {after.evidence[1]:.3f} after;",
        f"# log-likelihood, nats per beam: {before.likelihood[1]:.3f} before, {after.likelihood[1]:.3f} after.",
        *(f"# Not learned: {remark}." for remark in tuning.remarks),
        "",
        *(f"{name}: {number(getattr(tuning.after, name))}" for name in PARAMETERS),
    ]
    if kept:
        lines += ["", "# As the logs were run:", *(f"{name}: {_plain(value)}" for name, value in kept.items())]
    return "\n".join(lines) + "\n"


def table(tuning: Tuning) -> list[tuple[str, str, str]]:
    """Every parameter and score before and after, in the order of COLUMNS."""
    rows = [(name, number(getattr(tuning.before, name)), number(getattr(tuning.after, name))) for name in PARAMETERS]
    own = tuning.after.own.items()
    rows += [(name, _own(tuning.before.own[name]), _own(value)) for name, value in own]
    before, after = tuning.before_scores, tuning.after_scores
    for i, part in enumerate(("learned from", "held out")):
        rows.append((f"nats per beam, {part}", f"{before.likelihood[i]:.3f}", f"{after.likelihood[i]:.3f}"))
        rows.append((f"nats per scan, {part}", f"{before.evidence[i]:.3f}", f"{after.evidence[i]:.3f}"))
    return rows


def origin(tuning: Tuning) -> str:
    """Lines that say from which logs it was learned."""
    lines = [f"Learned by `mcl tune` from {log.name} (SHA-256 {log.sha256[:12]})" for log in tuning.logs]
    return "\n".join([*lines, f"seed {tuning.seed}; {tuning.scans:,} scans, {tuning.beams:,} beams."])


def number(value: float | str | None) -> str:
    """A value of a table."""
    return "null" if value is None else value if isinstance(value, str) else f"{value:.4g}"


def _default(name: str) -> Any:
    """None of a parameter of the user's own: it is always told."""
    return Config.model_fields[name].default if name in Config.model_fields else None


def _own(value: bool | float | str | None) -> str:
    return number(value) if isinstance(value, float) else _plain(value)


def _plain(value: Any) -> str:
    return "null" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
