"""Every parameter of a run: name, unit, bounds, default. Names are AMCL's and Probabilistic Robotics' own.

Order of precedence: defaults < preset or ``--config`` file < ``--set key=value`` < a flag of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from io import StringIO
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError, field_validator, model_serializer, model_validator
from pydantic import Field as PydanticField

from pipeline import nav2
from pipeline.errors import MclError
from pipeline.explained import what_is_taken
from pipeline.parts.loading import Part, load
from pipeline.parts.loading import check_name as check_part
from pipeline.parts.own import Own
from pipeline.parts.roles import ROLES
from pipeline.spelling import did_you_mean, meant_or_known
from pipeline.wrong_values import expectation
from pipeline.yaml_errors import yaml_told

Field: Any = PydanticField  # Checkers of types take that one for a parameter without a default.
PRESETS = Path(__file__).parent / "presets"

LARGEST = 1e6
"""What no parameter exceeds, in whatever unit: a larger number was never meant."""
NonNegative = Annotated[float, Field(ge=0.0)]
Positive = Annotated[float, Field(gt=0.0)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]


def _part(role: str, default: str, description: str) -> Any:
    """A parameter that names a part: a built-in one, or one of the user's own."""
    return Field(default, description=description, json_schema_extra={"enum": list(ROLES[role].built_in)})


class Config(BaseModel):
    """The effective configuration of a run. Lengths in metres, angles in radians, densities per metre."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    # --- where the belief starts -------------------------------------------------------------------
    init: str = _part(
        "init",
        "exhaustive",
        "Start by scoring every pose, over the free cells, over the whole map, or around initial_pose.",
    )
    initial_pose: tuple[float, float, float] | None = Field(
        None, description="x, y (m), yaw (rad) in the map frame, for init=pose."
    )
    initial_pose_std: tuple[NonNegative, NonNegative, NonNegative] = Field(
        (0.5, 0.5, 0.26), description="Standard deviations of x, y (m) and yaw (rad), for init=pose."
    )

    # --- what the belief is made of ------------------------------------------------------------------
    filter: str = _part(
        "filter",
        "mcl",
        "Monte Carlo localization (Table 8.2); grid localization (Table 8.1), which is slow; or an extended Kalman "
        "filter that matches walls (Table 7.2), which needs init=pose.",
    )
    grid_d: float = Field(0.1, ge=0.02, le=2.0, description="filter=grid: edge of a cell, m.")
    grid_a: float = Field(
        0.035, ge=0.005, le=1.0, description="filter=grid: turn from one heading of cells to the next, rad."
    )

    # --- how many particles --------------------------------------------------------------------------
    max_particles: int = Field(30_000, ge=1, le=20_000_000, description="Particles at the start, and never more.")
    min_particles: int = Field(1_000, ge=1, description="Never fewer than these, nor more than max_particles.")
    adaptive: Literal["kld", "duplicates", "none"] = Field(
        "kld", description="Their number: by KLD-sampling (Table 8.4), the report's proposal, or always max_particles."
    )
    kld_err: Positive = Field(0.05, description="Largest error allowed between the belief and the particles (KLD).")
    kld_z: Positive = Field(2.33, description="Quantile of the standard normal for that error: 2.33 is 99 %.")

    # --- who says how the robot moved -------------------------------------------------------------------
    odometry: Literal["both", "wheels", "laser"] = Field(
        "both",
        description="Who says how the robot moved: the wheels and the laser's own odometry, or one of them alone. "
        "Without wheels it is the laser in any case.",
    )
    laser_share: Fraction = Field(
        0.9,
        description="Of the particles that follow the laser, so many do so with its own small noise, "
        "the rest with the wheels' noise.",
    )
    laser_drift_d: NonNegative = Field(
        0.01, description="How far the laser's odometry drifts in one metre, along and across: a deviation, m."
    )
    laser_drift_a: NonNegative = Field(0.0025, description="How far its heading drifts in one metre: a deviation, rad.")

    without: tuple[Literal["gaps", "faults", "loosely", "proposals", "deskewing", "off_map", "memory"], ...] = Field(
        (),
        description="Parts of the filter that are left out, to see what they are good for: gaps as events, "
        "faults of the wheels, particles that follow the laser loosely, poses that the scan proposes, "
        "beams put right in time, land that the map does not know, and the memory of what the log has shown.",
    )

    # --- motion model of the wheels ----------------------------------------------------------------------
    motion_model: str = _part(
        "motion_model",
        "odometry",
        "How far a step may be from what the wheels say: Table 5.6, or AMCL's model of a robot that drives in any "
        "direction.",
    )
    alpha1: NonNegative = Field(0.02, description="Variance of rotation from rotation, rad^2/rad^2.")
    alpha2: NonNegative = Field(0.02, description="Variance of rotation from translation, rad^2/m^2.")
    alpha3: NonNegative = Field(0.02, description="Variance of translation from translation, m^2/m^2.")
    alpha4: NonNegative = Field(0.002, description="Variance of translation from rotation, m^2/rad^2.")
    alpha5: NonNegative = Field(
        0.02, description="motion_model=omnidirectional: variance of sideways drift from translation, m^2/m^2."
    )

    # --- which beams are used ----------------------------------------------------------------------------
    max_beams: int = Field(60, ge=1, description="Use at most so many beams, spread evenly over the scan.")
    beam_step: int | None = Field(None, ge=1, description="Use every n-th beam instead of max_beams.")
    laser_min_range: NonNegative = Field(
        0.0, description="Readings no longer than this say nothing, m, nor those below the scan's own shortest range."
    )
    laser_max_range: Positive | None = Field(
        None, description="Longest range that counts, m; the scan's own if that is shorter, or if not given."
    )
    no_return_fraction: Fraction = Field(1.0, description="From this share of the maximum range on: 'no return'.")
    range_bias: float | None = Field(
        None,
        description="Taken off every measured range, m: walls that the map draws too near. "
        "Not given: starts at half the thickness of the map's walls and follows the residuals of a converged filter.",
    )

    # --- which sensor model ----------------------------------------------------------------------------------
    sensor_model: str = _part(
        "sensor_model",
        "beam",
        "Table 6.1; Table 6.3; AMCL's likelihood_field_prob; its likelihood_field, a sum of cubes. "
        "Searches of the building use a beam model in any case.",
    )
    laser_likelihood_max_dist: Positive = Field(
        2.0, description="Likelihood fields: no beam ends farther than this from an obstacle, m."
    )
    do_beamskip: bool = Field(
        False,
        description="likelihood_field_prob: skip beams that most particles disagree with, once they are together.",
    )
    beam_skip_distance: NonNegative = Field(0.5, description="A beam that ends so near an obstacle agrees with it, m.")
    beam_skip_threshold: Fraction = Field(
        0.3, description="Beams that agree at no more than this share of the particles are skipped."
    )
    beam_skip_error_threshold: Fraction = Field(
        0.9, description="Where this share of the beams or more would be skipped, none is: the particles are wrong."
    )

    # --- beam model (Table 6.1); z_hit, z_rand and sigma_hit are the likelihood fields' as well --------------------
    z_hit: NonNegative = Field(0.6, description="Weight of the Gaussian around the true range.")
    z_short: NonNegative = Field(0.1, description="Weight of unexpected obstacles before it.")
    z_max: NonNegative = Field(0.05, description="Weight (a mass) of readings without return.")
    z_rand: NonNegative = Field(0.1, description="Weight of unexplained readings, uniform over the range.")
    z_long: NonNegative = Field(0.15, description="Weight of readings beyond it: open doors, rooms that the map lacks.")
    sigma_hit: Positive = Field(0.15, description="Standard deviation of the Gaussian, m.")
    lambda_short: Positive = Field(0.5, description="Rate of the exponential of unexpected obstacles, 1/m.")
    lambda_long: Positive = Field(0.3, description="Rate of the exponential of readings beyond the true range, 1/m.")
    independent_beams: Positive | None = Field(
        4.0,
        description="A scan counts as so many independent beams, however many are used: neighbours err together. "
        "Not given: every beam counts in full.",
    )

    # --- true ranges from the map ----------------------------------------------------------------------------
    occupied_threshold: Fraction | None = Field(
        None,
        description="A cell so probably occupied, or more, stops a ray. null: 0.97, or 0.65 if walls are grey.",
    )
    free_threshold: Fraction = Field(0.25, description="Cells less probably occupied than this may hold the robot.")
    ray_caster: Literal["table", "dda", "bresenham"] = Field(
        "table", description="Where z* comes from: a pre-computed table, Amanatides and Woo, Bresenham's line."
    )

    # --- resampling ---------------------------------------------------------------------------------------------
    resampler: str = _part("resampler", "low_variance", "Table 4.4, or independent draws.")
    resample_ess: Fraction = Field(0.5, description="Resample when the effective sample size falls below this share.")
    resample_interval: int = Field(1, ge=1, description="Ask whether to resample at every n-th update only.")
    update_min_d: NonNegative = Field(0.01, description="The robot stands still below this travel, m: no update then.")
    update_min_a: NonNegative = Field(0.01, description="... and below this turn, rad.")

    # --- when the belief is in doubt ---------------------------------------------------------------------------------
    recovery: Literal["search", "augmented", "none"] = Field(
        "search",
        description="Rivals from a search of the building, random ones by w_slow and w_fast (Table 8.3), none.",
    )
    recovery_alpha_slow: Fraction = Field(0.001, description="Rate of the slow average of the likelihood.")
    recovery_alpha_fast: Fraction = Field(0.1, description="Rate of the fast one.")
    hindsight: bool = Field(
        True, description="Keep the beliefs, and tell at the end where the robot was from the start."
    )

    # --- the recording --------------------------------------------------------------------------------------------
    record_particles: int = Field(
        2000, ge=0, description="At most so many particles are recorded per scan, drawn at random."
    )

    # --- parts of the user's own ------------------------------------------------------------------------------------
    own: dict[str, bool | int | float | str | None] = Field(
        {}, description="Parameters of parts of your own, each by a name like `sensor_model.sharpness`."
    )

    @model_validator(mode="before")
    @classmethod
    def _by_their_names(cls, values: Any) -> Any:
        """AMCL's name of the sensor model is read as well; parameters of own parts have a dot in their names."""
        if not isinstance(values, Mapping):
            return values
        named = {ALIASES.get(key, key): value for key, value in values.items()}
        own = {key: named.pop(key) for key in list(named) if key.partition(".")[0] in ROLES and "." in key}
        return named | ({"own": {**named.get("own", {}), **own}} if own else {})

    @field_validator(*ROLES)
    @classmethod
    def _known(cls, name: str, info: Any) -> str:
        return check_part(ROLES[info.field_name], name)

    @model_serializer(mode="wrap")
    def _flat(self, handler: Any) -> dict[str, Any]:
        """Parameters of own parts stand behind the part that they belong to."""
        values = handler(self)
        own, out = values.pop("own", {}), dict[str, Any]()
        for key, value in values.items():
            out |= {key: value} | {name: v for name, v in own.items() if name.partition(".")[0] == key}
        return out

    def written(self, role: str) -> tuple[Part, dict[str, Any]] | None:
        """The part of a user's own that fills a role, as it is written, with its parameters; None if it is built in.

        Raises MclError if it cannot be loaded, or a parameter is wrong.
        """
        name: str = getattr(self, role)
        if name in ROLES[role].built_in:
            return None
        part = load(ROLES[role], name)
        return part, part.settled({key.partition(".")[2]: self.own[key] for key in self.own_of(role)})

    def own_of(self, role: str) -> list[str]:
        """Names of the own parameters that are given of a role's part."""
        return [key for key in self.own if key.partition(".")[0] == role]

    def own_part(self, role: str, **offered: Any) -> Own | None:
        """The part of a user's own that fills a role, ready to be called; None if it is a built-in one."""
        found = self.written(role)
        return None if found is None else Own(*found, config=self, **offered)

    @model_validator(mode="after")
    def _consistent(self) -> Config:
        for name, value in self:
            if isinstance(value, float) and abs(value) > LARGEST:
                raise ValueError(f"{name} is {value:g}, which no parameter is")
        if self.init == "pose" and self.initial_pose is None:
            raise ValueError("init=pose needs initial_pose: [x, y, yaw]")
        if self.z_hit + self.z_short + self.z_max + self.z_rand + self.z_long <= 0.0:
            raise ValueError("z_hit, z_short, z_long, z_max and z_rand must not all be zero")
        return self


def preset_names() -> list[str]:
    """Names that ``--config`` takes besides the path of a file."""
    return sorted(p.stem for p in PRESETS.glob("*.yaml"))


def preset_description(name: str) -> str:
    """The first line of a preset's file, a comment that says what it is for."""
    line = (PRESETS / f"{name}.yaml").read_text(encoding="utf-8").partition("\n")[0]
    return line.removeprefix("#").strip() if line.startswith("#") else ""


def load_config(
    source: str | Path | None = None,
    overrides: Iterable[str] = (),
    *,
    remark: Callable[[str], object] = str,
    **flags: Any,
) -> Config:
    """Defaults, then the preset or file ``source``, then ``key=value`` strings, then flags that are not None.

    The file may hold AMCL's parameters, for nav2 or for ROS 1, or be a launch file with them: see ``nav2``. What of
    those has no meaning here, and what earlier versions had, is told to ``remark``, a line each. Raises MclError for an
    unknown key (naming the nearest one), a value out of bounds, a file that is neither YAML nor a launch file.
    """
    values: dict[str, Any] = {}
    theirs: Mapping[str, str] = {}
    if source is not None:
        values, theirs = nav2.in_our_words(_read(source, remark), source, remark)
    typed: dict[str, Any] = {}
    for text in overrides:
        key, sep, value = text.partition("=")
        if not sep:
            raise MclError(f"--set {text!r}: expected key=value")
        typed[key.strip()] = _yaml_value(value, f"--set {text}")
    typed |= {k: v for k, v in flags.items() if v is not None}
    for where, given in ((source, values), ("--set", typed)):
        for key in RETIRED.keys() & given.keys():
            del given[key]
            remark(f"{where}: the parameter {key!r} is gone, and not read: {RETIRED[key]}")
    # What is wrong is blamed on the file only if it stands there, and nothing typed takes its place.
    return _with_own_parts(_validate(values | typed, {key: source for key in values if key not in typed}, theirs))


ALIASES: Mapping[str, str] = {"laser_model_type": "sensor_model"}
"""Other names of parameters that are read as well: AMCL's, which was ours."""
RETIRED: Mapping[str, str] = {
    "slip": "the laser sees through wheels that slip (odometry=both), and wheels alone are taken at their word",
}
"""Parameters of earlier versions: what there is instead. Files and settings that still have them are read without."""


def check_name(key: str, source: str | Path | None = None) -> None:
    """Raises MclError, naming the nearest one, if there is no parameter of that name; ``source``: where it stands."""
    if key in RETIRED:
        raise MclError(f"the parameter {key!r} is gone", RETIRED[key], path=source)
    if key.partition(".")[0] in ROLES:
        return  # of an own part, which is asked itself
    if key not in Config.model_fields and key not in ALIASES:
        ours = nav2.OURS.get(key, key)
        _, dot, own = key.partition(".")
        known = [f"{name}.{own}" for name in ROLES] if dot else Config.model_fields
        hint = did_you_mean(ours, known)
        raise MclError(f"unknown parameter {key!r}", hint or "mcl config lists all", path=source)


def _with_own_parts(config: Config) -> Config:
    """The same with all parameters of the user's own parts, those with their defaults included."""
    own = dict[str, Any]()
    for role in ROLES:
        if found := config.written(role):
            own |= {f"{role}.{key}": value for key, value in found[1].items()}
        elif given := config.own_of(role):
            hint = f"{role} is {getattr(config, role)}, whose parameters have names without a dot"
            raise MclError(f"unknown parameter {given[0]!r}", hint)
    return config.model_copy(update={"own": own})


def dump_config(config: Config) -> str:
    """The configuration as YAML that ``load_config`` reads back."""
    from ruamel.yaml import YAML

    out = StringIO()
    yaml = YAML(typ="safe")
    yaml.default_flow_style = None
    # Keep the order of the fields, which tells the story.
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.dump(config.model_dump(mode="json"), out)
    return out.getvalue()


def _read(source: str | Path, remark: Callable[[str], object]) -> dict[str, Any]:
    from ruamel.yaml import YAML

    path = PRESETS / f"{source}.yaml" if str(source) in preset_names() else Path(source)
    if not path.is_file():
        raise MclError("no such config file or preset", meant_or_known(str(source), preset_names()), path=path)
    try:
        text = path.read_text()
    except UnicodeDecodeError as error:
        raise MclError("not a text file", "expected YAML: parameter: value", path=path) from error
    with yaml_told(path):
        values = nav2.values_of_launch(text, path, remark) if nav2.is_launch(text) else YAML(typ="safe").load(text)
    values = {} if values is None else values
    if not isinstance(values, Mapping):
        raise MclError("expected a mapping of parameter: value", path=path)
    return {str(k): v for k, v in values.items()}


def _yaml_value(text: str, where: str) -> Any:
    from ruamel.yaml import YAML

    try:
        return YAML(typ="safe").load(text)
    except Exception as error:  # YAMLError, and what Python cannot hold
        raise MclError(f"{where}: the value is not YAML") from error


def _validate(values: Mapping[str, Any], file_of: Mapping[str, str | Path | None], theirs: Mapping[str, str]) -> Config:
    """``file_of``: where a value stands, and ``theirs``: what it is called there, if that is another name."""
    for key in values:
        check_name(key, file_of.get(key))
    try:
        return Config.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        name = str(first["loc"][0]) if first["loc"] else ""
        file = file_of.get(name)
        key = ".".join(str(p) for p in first["loc"])
        key = theirs.get(key, key) if file is not None else key
        said = expectation(first)
        if first["type"] != "value_error" and name in Config.model_fields:
            key = key.partition(".")[0]
            said = f"expected {what_is_taken(name, Config.model_json_schema()['properties'][name])}"
        got = values[name] if name in values else first["input"]
        raise MclError(f"{key}: {said}, got {got!r}" if key else said, path=file) from error
