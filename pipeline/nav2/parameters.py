"""Every parameter of AMCL: its type, bounds and default as nav2's configuration guide gives them, and what it is here.

Reader, writer and checker of parameter files ask this one table. The guide states types and defaults. It states few
bounds: where it states none, they are what the formula behind the parameter allows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

Kind = Literal["double", "integer", "bool", "string"]
LARGEST: Final = 1e300
ANY: Final = -LARGEST


@dataclass(frozen=True)
class Parameter:
    """One of AMCL's: nav2's ``default``, whose type is the parameter's; ``least`` and ``most`` of a number.

    ``above``: it must be more than ``least``. ``off``: a number outside the bounds that has a meaning of its own.
    ``choices``: the words that a text may be. ``here``: our parameter of the same meaning, empty where there is none,
    and ``translated``: its value is said in another way there.
    """

    name: str
    default: bool | int | float | str
    least: float = ANY
    most: float = LARGEST
    above: bool = False
    off: float | None = None
    choices: tuple[str, ...] = ()
    here: str = ""
    translated: bool = False

    @property
    def kind(self) -> Kind:
        """The type that nav2 declares, and insists on."""
        kinds: dict[type, Kind] = {bool: "bool", int: "integer", float: "double", str: "string"}
        return kinds[type(self.default)]

    def wrong_type(self, value: Any) -> str:
        """What ``value`` is, in words, if nav2 would refuse it at the start for its type; empty if it would not."""
        is_a = kind_of(value)
        return "" if is_a == self.kind else is_a

    def wrong_value(self, value: Any) -> str:
        """What was expected instead of a ``value`` of the right type; empty if it is within the bounds."""
        if self.choices:
            return "" if value in self.choices else f"one of {', '.join(self.choices)}"
        if self.kind not in ("double", "integer") or value == self.off:
            return ""
        low = value > self.least if self.above else value >= self.least
        return "" if low and value <= self.most else self.bounds  # nor is a NaN within them

    @property
    def bounds(self) -> str:
        """The bounds of a number in words; empty if it has none."""
        words = []
        if self.least > ANY:
            words.append(f"{'more than' if self.above else 'at least'} {self.least:g}")
        if self.most < LARGEST:
            words.append(f"at most {self.most:g}")
        said = " and ".join(words)
        return f"{said}, or {self.off:g}" if said and self.off is not None else said

    def written(self, value: float | str) -> str:
        """The value as nav2 reads it back: a double always has its point, an integer never has one."""
        if self.kind == "double":
            return plain(float(value))
        if self.kind == "bool":
            return "true" if value else "false"
        return str(int(value)) if self.kind == "integer" else f'"{value}"'


def kind_of(value: Any) -> str:
    """The type that ROS sees in a value of a parameter file."""
    for is_a, word in ((bool, "bool"), (int, "integer"), (float, "double"), (str, "string"), (list, "list")):
        if isinstance(value, is_a):
            return word
    return "nothing" if value is None else "mapping"


def plain(value: float) -> str:
    """A double with four digits, a point and no exponent: 0.2, 12.0, 0.0005."""
    text = f"{float(f'{value:.4g}'):.12f}".rstrip("0")
    return f"{text}0" if text.endswith(".") else text


_ALL: Final = (
    Parameter("alpha1", 0.2, 0.0, here="alpha1"),
    Parameter("alpha2", 0.2, 0.0, here="alpha2"),
    Parameter("alpha3", 0.2, 0.0, here="alpha3"),
    Parameter("alpha4", 0.2, 0.0, here="alpha4"),
    Parameter("alpha5", 0.2, 0.0, here="alpha5"),
    Parameter("always_reset_initial_pose", False),
    Parameter("base_frame_id", "base_footprint"),
    Parameter("beam_skip_distance", 0.5, 0.0, here="beam_skip_distance"),
    Parameter("beam_skip_error_threshold", 0.9, 0.0, 1.0, here="beam_skip_error_threshold"),
    Parameter("beam_skip_threshold", 0.3, 0.0, 1.0, here="beam_skip_threshold"),
    Parameter("do_beamskip", False, here="do_beamskip"),
    Parameter("first_map_only", False),
    Parameter("freespace_downsampling", False),
    Parameter("global_frame_id", "map"),
    Parameter("initial_pose.x", 0.0, here="initial_pose", translated=True),
    Parameter("initial_pose.y", 0.0, here="initial_pose", translated=True),
    Parameter("initial_pose.yaw", 0.0, here="initial_pose", translated=True),
    Parameter("initial_pose.z", 0.0),
    Parameter("lambda_short", 0.1, 0.0, above=True, here="lambda_short"),
    Parameter("laser_likelihood_max_dist", 2.0, 0.0, above=True, here="laser_likelihood_max_dist"),
    Parameter("laser_max_range", 100.0, 0.0, above=True, off=-1.0, here="laser_max_range", translated=True),
    Parameter("laser_min_range", -1.0, 0.0, off=-1.0, here="laser_min_range", translated=True),
    Parameter(
        "laser_model_type", "likelihood_field", choices=("beam", "likelihood_field", "likelihood_field_prob"),
        here="sensor_model", translated=True,
    ),
    Parameter("map_topic", "map"),
    Parameter("max_beams", 60, 2, here="max_beams"),
    Parameter("max_particles", 2000, 1, here="max_particles"),
    Parameter("min_particles", 500, 1, here="min_particles"),
    Parameter("odom_frame_id", "odom"),
    Parameter("pf_err", 0.05, 0.0, 1.0, above=True, here="kld_err"),
    Parameter("pf_z", 0.99, 0.0, above=True, here="kld_z"),
    Parameter("random_seed", -1, -1),
    Parameter("recovery_alpha_fast", 0.0, 0.0, 1.0, here="recovery_alpha_fast"),
    Parameter("recovery_alpha_slow", 0.0, 0.0, 1.0, here="recovery_alpha_slow"),
    Parameter("resample_interval", 1, 1, here="resample_interval", translated=True),
    Parameter(
        "robot_model_type", "nav2_amcl::DifferentialMotionModel", here="motion_model", translated=True,
        choices=("nav2_amcl::DifferentialMotionModel", "nav2_amcl::OmniMotionModel", "differential", "omnidirectional"),
    ),
    Parameter("save_pose_rate", 0.5, 0.0, above=True, off=-1.0),
    Parameter("scan_topic", "scan"),
    Parameter("set_initial_pose", False, here="init", translated=True),
    Parameter("sigma_hit", 0.2, 0.0, above=True, here="sigma_hit"),
    Parameter("tf_broadcast", True),
    Parameter("transform_tolerance", 1.0, 0.0),
    Parameter("update_min_a", 0.2, 0.0, here="update_min_a"),
    Parameter("update_min_d", 0.25, 0.0, here="update_min_d"),
    Parameter("use_sim_time", False),
    Parameter("z_hit", 0.5, 0.0, 1.0, here="z_hit"),
    Parameter("z_max", 0.05, 0.0, 1.0, here="z_max"),
    Parameter("z_rand", 0.5, 0.0, 1.0, here="z_rand"),
    Parameter("z_short", 0.05, 0.0, 1.0, here="z_short"),
)  # fmt: skip

PARAMETERS: Final[Mapping[str, Parameter]] = {parameter.name: parameter for parameter in _ALL}
DEFAULTS: Final[Mapping[str, Any]] = {name: parameter.default for name, parameter in PARAMETERS.items()}
"""What AMCL takes where a file says nothing."""
OF_EVERY_NODE: Final = ("qos_overrides", "service_introspection_mode", "introspection_mode", "bond_heartbeat_period")
"""What every node of nav2 takes besides; of dotted names the first part. Nothing of it concerns localization."""
