"""AMCL's parameters in those of this program.

A file that names AMCL's parameters asks for AMCL: what it leaves out has AMCL's default, not ours, and ranges make
weights as they do there. What AMCL does not have at all keeps our default: the search of the building at the
start, hindsight, the recording. docs/parameters.md compares the parameters one by one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pipeline.nav2.given import Given, given_in
from pipeline.nav2.parameters import PARAMETERS

MODELS: Final = {
    "beam": "beam",
    "likelihood_field": "likelihood_field_cubes",
    "likelihood_field_prob": "likelihood_field_prob",
}
DRIVES: Final = {
    "nav2_amcl::DifferentialMotionModel": "odometry",
    "nav2_amcl::OmniMotionModel": "omnidirectional",
    "differential": "odometry",
    "omnidirectional": "omnidirectional",
}
OURS: Final[Mapping[str, str]] = {p.name: p.here for p in PARAMETERS.values() if p.here and not p.translated}
"""AMCL's name -> ours, where the value is the same."""


@dataclass(frozen=True)
class Translation:
    """``values`` of our parameters, ``theirs``: what the file calls them, where that is another name.

    ``remarks``: a line each, on what the file says and this program does not do.
    """

    values: dict[str, Any]
    theirs: dict[str, str]
    remarks: tuple[str, ...]


def in_our_words(
    values: dict[str, Any], path: Path | str, remark: Callable[[str], object]
) -> tuple[dict[str, Any], Mapping[str, str]]:
    """The values of a file, translated if it is one of AMCL's, and what the file calls those with another name there.

    What has no meaning here is told to ``remark``, a line each. Raises MclError as ``translate`` does.
    """
    given = given_in(values, path)
    if given is None:
        return values, {}
    found = translate(given)
    for text in found.remarks:
        remark(text)
    return found.values, found.theirs


def translate(given: Given) -> Translation:
    """What a file gives, in our words. Raises MclError for a value that AMCL would not take."""
    remarks: list[str] = []
    model = given.one_of("laser_model_type", MODELS)
    ours: dict[str, Any] = {here: given.get(name) for name, here in OURS.items()}
    ours["sensor_model"] = MODELS[model]
    # -1 asks for the laser's own limit.
    shortest, longest = given.number("laser_min_range"), given.number("laser_max_range")
    ours["laser_min_range"] = max(0.0, shortest)
    ours["laser_max_range"] = longest if longest > 0.0 else None
    ours["range_bias"] = 0.0  # ranges count as they were measured
    rates = given.number("recovery_alpha_slow"), given.number("recovery_alpha_fast")
    ours["recovery"] = "augmented" if max(rates) > 0.0 else "none"
    if given.number("min_particles") > given.number("max_particles"):
        ours["max_particles"] = ours["min_particles"]  # as AMCL does, with a warning
    if model == "likelihood_field_prob":
        ours["independent_beams"] = None  # it multiplies all of its beams; the other two add up cubes
    if model == "beam":
        # AMCL's Gaussian is 1 at the true range, ours a density; and it knows no readings that are too long.
        ours["z_hit"] = given.number("z_hit") * given.number("sigma_hit") * math.sqrt(2.0 * math.pi)
        ours["z_long"] = 0.0
        said = "AMCL adds up cubes of its beams; here they multiply, as independent_beams"
        remarks.append(f"{given.path}: laser_model_type beam: {said}")
    # AMCL asks nothing of the weights: every so many updates it resamples.
    ours["resample_ess"] = 1.0
    ours["resample_interval"] = max(1, round(given.number("resample_interval")))
    _set_start(ours, given)
    drive = str(given.get("robot_model_type"))
    ours["motion_model"] = DRIVES.get(drive, "odometry")
    if drive not in DRIVES:
        said = f"{given.name('robot_model_type')} {drive} is unknown: the differential model is taken"
        remarks.append(f"{given.path}: {said}")
    theirs = {here: given.name(name) for name, here in OURS.items() if given.name(name) != here}
    return Translation({**ours, **given.own}, theirs, (*given.ignored(), *given.remarks, *remarks))


def _set_start(ours: dict[str, Any], given: Given) -> None:
    pose = [f"initial_pose.{axis}" for axis in ("x", "y", "yaw")]
    if given.flag("set_initial_pose"):
        ours["init"] = "pose"
    elif not any(name in given.values for name in pose):
        return  # AMCL would wait for somebody to tell it: our own search of the building needs nobody
    ours["initial_pose"] = [given.number(name) for name in pose]
