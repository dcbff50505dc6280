"""Whether a parameter file of AMCL fits a log: its frames and topic, its ranges, and its noise."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from pipeline import nav2, tune
from pipeline.check.amcl_file import Checked, sound
from pipeline.check.findings import Finding
from pipeline.check.laser import findings_of_limits
from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.logs import schema
from pipeline.logs.messages import Log

FAR: Final = {"alpha1": 3.0, "alpha2": 3.0, "alpha3": 3.0, "alpha4": 3.0, "sigma_hit": 3.0}
"""A deviation that is so many times that of the log, or as small a part of it, is far from it."""
SMALLEST: Final = 0.02
"""m, rad: noise of one update below which nothing is lost by another value of it."""


def findings_of_log(file: Checked, log: Log, config: Config, *, seed: int = 0) -> Iterator[Finding]:
    """What the log says otherwise. Localizes it, if it has a map; ``config``: how."""
    file = sound(file)
    yield from _names(file, log)
    yield from _limits(file, log, config)
    if log.grid is None:
        yield Finding("noted", "map", "There is no map: alphas and sigma_hit are not compared.", "Give one with --map.")
        return
    try:
        learned = tune.tune([log], config, seed=seed)
    except MclError as error:
        text = f"The robot is not found in this log, so that alphas and sigma_hit are not compared: {error.message}."
        yield Finding("noted", "reading", text, "mcl check tells what is wrong with the log.")
        return
    yield from _noise(file, learned)


def _names(file: Checked, log: Log) -> Iterator[Finding]:
    """Frames and topic, where the log still has the names that the robot uses."""
    source = log.metadata.get(schema.SOURCE, {})
    if source and "scan_topic" not in source:
        return  # a raw log, or a simulated one, whose names are ours
    told = {**log.metadata.get(schema.READER, {}), **source}
    odom, base = [*told.get("frames", "").split(" -> "), "", ""][:2]
    wanted = (("scan_topic", told.get("scan_topic", "")), ("odom_frame_id", odom), ("base_frame_id", base))
    for name, seen in wanted:
        said = str(file.given.get(name)).lstrip("/")
        if seen and said != seen.lstrip("/"):
            text = f"{file.given.name(name)} is {said!r}; this log has {seen.lstrip('/')!r}."
            yield file.finding("doubtful", name, text, f"Write {seen.lstrip('/')}, unless the robot has both.")


def _limits(file: Checked, log: Log, config: Config) -> Iterator[Finding]:
    shortest, longest = (file.given.number(f"laser_{word}_range") for word in ("min", "max"))
    if 0.0 < longest <= shortest:
        return  # told already
    limits = {"laser_min_range": max(0.0, shortest), "laser_max_range": longest if longest > 0.0 else None}
    for finding in findings_of_limits(log, config.model_copy(update=limits)):
        name = "laser_max_range" if finding.text.startswith("laser_max_range") else "laser_min_range"
        if finding.grade != "noted":  # AMCL's default of 100 m is more than most lasers', and harmless
            yield file.finding(finding.grade, name, finding.text, finding.do.replace("--set ", ""))


def _noise(file: Checked, learned: tune.Tuning) -> Iterator[Finding]:
    """Alphas and sigma_hit beside what was measured, each as the deviation that it means at one update."""
    d, a = (file.given.number(name) for name in ("update_min_d", "update_min_a"))
    size = {"alpha1": a, "alpha2": d, "alpha3": d, "alpha4": a}
    for reason in learned.amcl.reasons:
        if reason.name not in FAR or (reason.name == "sigma_hit" and file.given.get("laser_model_type") == "beam"):
            continue
        is_alpha = reason.name in size
        theirs, measured = file.given.number(reason.name), float(reason.value)
        said, shown = (math.sqrt(theirs), math.sqrt(measured)) if is_alpha else (theirs, measured)
        if max(said, shown) * size.get(reason.name, 1.0) < SMALLEST:
            continue
        if said <= FAR[reason.name] * shown and shown <= FAR[reason.name] * said:
            continue
        times = said / shown if said > shown else shown / max(said, 1e-9)
        what = "deviation that it means" if is_alpha else "value"
        yield file.finding(
            "doubtful", reason.name,
            f"{file.given.name(reason.name)} is {theirs:g}: the {what} is {times:.0f} times "
            f"{'what this log shows' if said > shown else 'smaller than this log shows'}: {reason.text}.",
            f"Write {nav2.PARAMETERS[reason.name].written(measured)}, or let mcl tune write all of them.",
        )  # fmt: skip
