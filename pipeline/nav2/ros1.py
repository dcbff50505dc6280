"""AMCL of ROS 1: its names and defaults, in those of nav2."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from pipeline.nav2.parameters import DEFAULTS as NAV2
from pipeline.nav2.parameters import PARAMETERS

_PARAMETERS: Final[Mapping[str, tuple[str, Any]]] = {
    "base_frame_id": ("base_frame_id", "base_link"),
    "beam_skip_distance": ("beam_skip_distance", 0.5),
    "beam_skip_error_threshold": ("beam_skip_error_threshold", 0.9),
    "beam_skip_threshold": ("beam_skip_threshold", 0.3),
    "do_beamskip": ("do_beamskip", False),
    "first_map_only": ("first_map_only", False),
    "global_frame_id": ("global_frame_id", "map"),
    "initial_pose_a": ("initial_pose.yaw", 0.0),
    "initial_pose_x": ("initial_pose.x", 0.0),
    "initial_pose_y": ("initial_pose.y", 0.0),
    "kld_err": ("pf_err", 0.01),
    "kld_z": ("pf_z", 0.99),
    "laser_lambda_short": ("lambda_short", 0.1),
    "laser_likelihood_max_dist": ("laser_likelihood_max_dist", 2.0),
    "laser_max_beams": ("max_beams", 30),
    "laser_max_range": ("laser_max_range", -1.0),
    "laser_min_range": ("laser_min_range", -1.0),
    "laser_model_type": ("laser_model_type", "likelihood_field"),
    "laser_sigma_hit": ("sigma_hit", 0.2),
    "laser_z_hit": ("z_hit", 0.95),
    "laser_z_max": ("z_max", 0.05),
    "laser_z_rand": ("z_rand", 0.05),
    "laser_z_short": ("z_short", 0.1),
    "max_particles": ("max_particles", 5000),
    "min_particles": ("min_particles", 100),
    "odom_alpha1": ("alpha1", 0.2),
    "odom_alpha2": ("alpha2", 0.2),
    "odom_alpha3": ("alpha3", 0.2),
    "odom_alpha4": ("alpha4", 0.2),
    "odom_alpha5": ("alpha5", 0.2),
    "odom_frame_id": ("odom_frame_id", "odom"),
    "odom_model_type": ("robot_model_type", "diff"),
    "recovery_alpha_fast": ("recovery_alpha_fast", 0.0),
    "recovery_alpha_slow": ("recovery_alpha_slow", 0.0),
    "resample_interval": ("resample_interval", 2),
    "save_pose_rate": ("save_pose_rate", 0.5),
    "tf_broadcast": ("tf_broadcast", True),
    "transform_tolerance": ("transform_tolerance", 0.1),
    "update_min_a": ("update_min_a", math.pi / 6.0),
    "update_min_d": ("update_min_d", 0.2),
}
"""ROS 1's name -> nav2's, and ROS 1's default."""
NAMES: Final[Mapping[str, str]] = {theirs: name for name, (theirs, _) in _PARAMETERS.items()}
"""nav2's name -> ROS 1's."""
DEFAULTS: Final[Mapping[str, Any]] = {**NAV2, **dict(_PARAMETERS.values())}
COVARIANCES: Final[Mapping[str, float]] = {
    "initial_cov_xx": 0.25,
    "initial_cov_yy": 0.25,
    "initial_cov_aa": (math.pi / 12.0) ** 2,
}
ABSENT: Final = (
    "bag_scan_period",
    "force_update_after_initialpose",
    "force_update_after_set_map",
    "gui_publish_rate",
    "restore_defaults",
    "selective_resampling",
    "use_map_topic",
)
"""What only a running node of ROS 1 has."""
ONLY: Final = frozenset(
    {name for name, (theirs, _) in _PARAMETERS.items() if name != theirs} - {"kld_err", "kld_z"}
) | {
    *COVARIANCES,
    "gui_publish_rate",
    "use_map_topic",
}
"""Names by which a plain YAML is known for one of ROS 1: neither we nor nav2 have them."""
DRIVES: Final = {
    "diff": "nav2_amcl::DifferentialMotionModel",
    "diff-corrected": "nav2_amcl::DifferentialMotionModel",
    "omni": "nav2_amcl::OmniMotionModel",
    "omni-corrected": "nav2_amcl::OmniMotionModel",
}
LEAST_STEP: Final = 0.05
"""m, rad: an update that is made at every scan is not shorter than about this."""


@dataclass(frozen=True)
class Taken:
    """What a file of ROS 1 gives: ``values`` by nav2's names, ``own`` parameters of this program, and ``remarks``."""

    values: dict[str, Any]
    own: dict[str, Any]
    remarks: tuple[str, ...]


def taken(given: Mapping[str, Any]) -> Taken:
    """AMCL's parameters by ROS 1's names, in those of nav2. What it does not know keeps its name."""
    values = {}
    for name, value in given.items():
        theirs = _PARAMETERS[name][0] if name in _PARAMETERS else name
        if name not in COVARIANCES:
            values[theirs] = _typed(theirs, value)
    own: dict[str, Any] = {}
    remarks: list[str] = []
    if any(name in given for name in ("initial_pose_x", "initial_pose_y", "initial_pose_a")):
        values["set_initial_pose"] = True
        own["initial_pose_std"] = [_deviation(given.get(name, least)) for name, least in COVARIANCES.items()]
    drive = values.get("robot_model_type", "diff")
    if drive == "diff":
        values |= _corrected(values)
        remarks.append(
            "odom_model_type diff: this model of ROS 1 takes the alphas' variances for deviations; here they are "
            "squared at the step of one update, which is what they do there. diff-corrected has them as nav2 does"
        )
    if str(drive) in DRIVES:
        values["robot_model_type"] = DRIVES[str(drive)]
    return Taken(values, own, tuple(remarks))


def _typed(name: str, value: Any) -> Any:
    """ROS 1 takes whole numbers for others, and the other way round if they are whole."""
    kind = PARAMETERS[name].kind if name in PARAMETERS else ""
    if kind == "double" and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if kind == "integer" and isinstance(value, float) and value.is_integer():
        return int(value)
    return value


def _corrected(values: Mapping[str, Any]) -> dict[str, Any]:
    """The alphas of diff as diff-corrected has them: alpha u^2 is a deviation in the one, a variance in the other.

    The two are equal at an update of the size u that AMCL waits for, update_min_d or update_min_a.
    """
    out = {}
    for k, step in ((1, "update_min_a"), (2, "update_min_d"), (3, "update_min_d"), (4, "update_min_a")):
        alpha, size = (values.get(name, DEFAULTS[name]) for name in (f"alpha{k}", step))
        if isinstance(alpha, float) and isinstance(size, float) and alpha >= 0.0:
            out[f"alpha{k}"] = (alpha * max(size, LEAST_STEP)) ** 2
    return out


def _deviation(variance: Any) -> Any:
    number = isinstance(variance, int | float) and not isinstance(variance, bool)
    return math.sqrt(variance) if number and variance >= 0.0 else variance
