"""AMCL's parameters, as nav2's own YAML files give them, in the parameters of this program.

A file that names AMCL's parameters asks for AMCL: what it leaves out has AMCL's default, not ours, and ranges make
weights as they do there. What AMCL does not have at all keeps our default: the search of the building at the
start, hindsight, the recording. docs/parameters.md compares the parameters one by one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pipeline.errors import MclError

_LARGEST: Final = 1e300
KEY: Final = "ros__parameters"
"""Below this key are the parameters of a ROS 2 node, in any of its parameter files."""
NODE: Final = "amcl"

SAME: Final[Mapping[str, Any]] = {
    "alpha1": 0.2,
    "alpha2": 0.2,
    "alpha3": 0.2,
    "alpha4": 0.2,
    "beam_skip_distance": 0.5,
    "beam_skip_error_threshold": 0.9,
    "beam_skip_threshold": 0.3,
    "do_beamskip": False,
    "lambda_short": 0.1,
    "laser_likelihood_max_dist": 2.0,
    "max_beams": 60,
    "max_particles": 2000,
    "min_particles": 500,
    "recovery_alpha_fast": 0.0,
    "recovery_alpha_slow": 0.0,
    "sigma_hit": 0.2,
    "update_min_a": 0.2,
    "update_min_d": 0.25,
    "z_hit": 0.5,
    "z_max": 0.05,
    "z_rand": 0.5,
    "z_short": 0.05,
}
"""Parameters of the same name here as there, with nav2_amcl's defaults."""
RENAMED: Final[Mapping[str, tuple[str, Any]]] = {"pf_err": ("kld_err", 0.05), "pf_z": ("kld_z", 0.99)}
"""Theirs -> ours, and AMCL's default. pf_z is the quantile, as kld_z is, whatever its pages say of a probability."""
TRANSLATED: Final[Mapping[str, Any]] = {
    "initial_pose.x": 0.0,
    "initial_pose.y": 0.0,
    "initial_pose.yaw": 0.0,
    "laser_max_range": 100.0,
    "laser_min_range": -1.0,
    "laser_model_type": "likelihood_field",
    "resample_interval": 1,
    "robot_model_type": "nav2_amcl::DifferentialMotionModel",
    "set_initial_pose": False,
}
"""Parameters whose meaning is said in another way here, with their defaults."""
OF_THE_NODE: Final = (
    "alpha5",
    "always_reset_initial_pose",
    "base_frame_id",
    "first_map_only",
    "freespace_downsampling",
    "global_frame_id",
    "initial_pose.z",
    "map_topic",
    "odom_frame_id",
    "random_seed",
    "save_pose_rate",
    "scan_topic",
    "tf_broadcast",
    "transform_tolerance",
    "use_sim_time",
)
"""Parameters of a running node, of a robot that moves sideways, or of another source of random numbers."""
MODELS: Final = {
    "beam": "beam",
    "likelihood_field": "likelihood_field_cubes",
    "likelihood_field_prob": "likelihood_field_prob",
}
DIFFERENTIAL: Final = ("differential", "nav2_amcl::DifferentialMotionModel")


@dataclass(frozen=True)
class Translation:
    """``values`` of our parameters, ``theirs``: what the file calls them, where that is another name.

    ``remarks``: a line each, on what the file says and this program does not do.
    """

    values: dict[str, Any]
    theirs: dict[str, str]
    remarks: tuple[str, ...]


def is_nav2(values: Mapping[Any, Any]) -> bool:
    """Whether these are the contents of a parameter file of ROS 2."""
    return any(True for _ in _nodes(values))


def translate(values: Mapping[Any, Any], path: Path | str) -> Translation:
    """AMCL's part of such a file, of which it may be the only one.

    Raises MclError if the file has no AMCL, more than one, or a value that AMCL would not take.
    """
    file = _File(_of_amcl(values, path), path)
    model = file.one_of("laser_model_type", MODELS)
    ours: dict[str, Any] = {name: file.given.get(name, default) for name, default in SAME.items()}
    ours |= {name: file.given.get(theirs, default) for theirs, (name, default) in RENAMED.items()}
    ours["sensor_model"] = MODELS[model]
    # -1 asks for the laser's own limit.
    shortest, longest = file.number("laser_min_range"), file.number("laser_max_range")
    ours["laser_min_range"] = max(0.0, shortest)
    ours["laser_max_range"] = longest if longest > 0.0 else None
    ours["range_bias"] = 0.0  # ranges count as they were measured
    rates = file.number("recovery_alpha_slow"), file.number("recovery_alpha_fast")
    ours["recovery"] = "augmented" if max(rates) > 0.0 else "none"
    if file.number("min_particles") > file.number("max_particles"):
        ours["max_particles"] = ours["min_particles"]  # as AMCL does, with a warning
    _set_weighing(ours, file, model)
    _set_resampling(ours, file)
    _set_start(ours, file)
    if file.text("robot_model_type") not in DIFFERENTIAL:
        file.remark(
            f"robot_model_type {file.text('robot_model_type')}: the odometry model is the differential one here"
        )
    theirs = {name: other for other, (name, _) in RENAMED.items()}
    return Translation(ours, theirs, (*file.ignored(), *file.remarks))


class _File:
    """The parameters that a file gives, with AMCL's defaults for the others; and what there is to say of them."""

    def __init__(self, given: Mapping[str, Any], path: Path | str) -> None:
        self.given, self.path = given, path
        self.remarks: list[str] = []

    def get(self, name: str) -> Any:
        return self.given.get(name, {**SAME, **TRANSLATED}[name])

    def number(self, name: str) -> float:
        value = self.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _LARGEST:
            raise MclError(f"{name}: expected a number, got {value!r}", path=self.path)
        return float(value)

    def flag(self, name: str) -> bool:
        value = self.get(name)
        if not isinstance(value, bool):
            raise MclError(f"{name}: expected true or false, got {value!r}", path=self.path)
        return value

    def text(self, name: str) -> str:
        return str(self.get(name))

    def one_of(self, name: str, choices: Mapping[str, Any]) -> str:
        if self.text(name) not in choices:
            known = ", ".join(choices)
            raise MclError(f"{name}: expected one of {known}, got {self.get(name)!r}", path=self.path)
        return self.text(name)

    def remark(self, text: str) -> None:
        self.remarks.append(f"{self.path}: {text}")

    def ignored(self) -> Iterator[str]:
        """A line that names what has no meaning here, if there is anything."""
        of_the_filter = {*SAME, *RENAMED, *TRANSLATED}
        names = [name for name in self.given if name not in of_the_filter]
        unknown = [name for name in names if name not in OF_THE_NODE]
        told = [name for name in names if name in OF_THE_NODE]
        if unknown:
            told.append(f"and what AMCL does not know: {', '.join(unknown)}")
        if told:
            yield f"{self.path}: parameters of AMCL; ignored: {', '.join(told)}"


def _set_weighing(ours: dict[str, Any], file: _File, model: str) -> None:
    """How beams make a weight: AMCL's likelihood_field_prob multiplies them all, its other two add up cubes."""
    if model == "likelihood_field_prob":
        ours["independent_beams"] = None
    if model == "beam":
        # AMCL's Gaussian is 1 at the true range, ours a density; and it knows no readings that are too long.
        ours["z_hit"] = file.number("z_hit") * file.number("sigma_hit") * math.sqrt(2.0 * math.pi)
        ours["z_long"] = 0.0
        file.remark("laser_model_type beam: AMCL adds up cubes of its beams; here they multiply, as independent_beams")


def _set_resampling(ours: dict[str, Any], file: _File) -> None:
    """AMCL asks nothing of the weights: every so many updates it resamples."""
    ours["resample_ess"] = 1.0
    ours["resample_interval"] = max(1, round(file.number("resample_interval")))


def _set_start(ours: dict[str, Any], file: _File) -> None:
    pose = [f"initial_pose.{axis}" for axis in ("x", "y", "yaw")]
    if file.flag("set_initial_pose"):
        ours["init"] = "pose"
    elif not any(name in file.given for name in pose):
        return  # AMCL would wait for somebody to tell it: our own search of the building needs nobody
    ours["initial_pose"] = [file.number(name) for name in pose]


def _of_amcl(values: Mapping[Any, Any], path: Path | str) -> dict[str, Any]:
    """AMCL's parameters by their dotted names: those of the node, over those given to every node."""
    nodes = dict(_nodes(values))
    found = [name for name in nodes if name.rpartition("/")[2] == NODE]
    every = {name: value for node in nodes if "*" in node for name, value in nodes[node].items() if _is_amcls(name)}
    if len(found) > 1:
        raise MclError(f"parameters of several AMCL nodes: {', '.join(found)}", "keep one of them", path=path)
    if not found and not every:
        raise MclError(f"no parameters of {NODE!r} in this ROS file: it has {', '.join(nodes)}", path=path)
    return every | (nodes[found[0]] if found else {})


def _is_amcls(name: str) -> bool:
    return name in SAME or name in RENAMED or name in TRANSLATED


def _nodes(values: Mapping[Any, Any], namespace: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Every node of a file with its parameters by their dotted names; nodes may stand in namespaces."""
    for key, below in values.items():
        if key == KEY:
            yield namespace or NODE, dict(_flat(below if isinstance(below, Mapping) else {}))
        elif isinstance(below, Mapping):
            yield from _nodes(below, f"{namespace}/{str(key).strip('/')}".lstrip("/"))


def _flat(values: Mapping[Any, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
