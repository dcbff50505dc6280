"""The places in the filter that a part fills, with the built-in parts of each: to add one, add its line here.

A part is a function, or a class whose objects have one of the role's methods. What it is given comes in three kinds:
the leading arguments, in their order, under whatever names; further ones, of which it gets those that it names; and
its own parameters, which have defaults and appear in the configuration as ``role.name``. docs/own_parts.md has an
example of each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Method:
    """One way to fill a role: ``leads``, the leading arguments in their order; ``offers``, those that it gets only if
    it names them. Which way a plain function is meant to be is told by the number of its leading arguments; or, where
    two ways have as many, by ``first``: it is this one if its first argument has that name."""

    name: str
    leads: tuple[str, ...]
    offers: tuple[str, ...] = ()
    first: str = ""


@dataclass(frozen=True)
class Role:
    """A parameter whose value is a part: the ``methods`` of which it must have one, what its constructor is offered if
    it is a class (``made_of``), the ``built_in`` parts by name, and the ``group`` of entry points of installed ones."""

    name: str
    methods: tuple[Method, ...]
    built_in: Mapping[str, str]
    made_of: tuple[str, ...] = ("grid", "laser", "config", "max_range")

    @property
    def group(self) -> str:
        """The group of entry points under which a package offers parts for this role."""
        return f"mcl_replay.{self.name}"


_ROLES: Final = (
    Role(
        "filter",
        (Method("update", ("scan", "step"), ("rng",)),),
        {
            "mcl": "pipeline.filter.particle_filter:ParticleFilter",
            "grid": "pipeline.filter.grid_filter:GridFilter",
            "ekf": "pipeline.filter.ekf:Ekf",
        },
    ),
    Role(
        "motion_model",
        (
            Method("gaussian", ("before", "after"), ("seconds",)),
            Method("sample", ("poses", "before", "after"), ("rng", "seconds")),
        ),
        {
            "odometry": "pipeline.motion.models:Odometry",
            "omnidirectional": "pipeline.motion.models:Omnidirectional",
        },
        made_of=("config",),
    ),
    Role(
        "sensor_model",
        (
            Method("log_likelihood", ("poses", "ranges"), ("angles", "expected"), first="poses"),
            Method("density", ("z", "expected")),
        ),
        {
            "beam": "pipeline.filter.beam_model:Mixture",
            "likelihood_field": "pipeline.filter.likelihood_field:LikelihoodField",
            "likelihood_field_prob": "pipeline.filter.likelihood_field:LikelihoodField",
            "likelihood_field_cubes": "pipeline.filter.likelihood_field:LikelihoodField",
        },
    ),
    Role(
        "resampler",
        (Method("draw", ("weights", "n"), ("rng",)),),
        {
            "low_variance": "pipeline.filter.resampling:low_variance",
            "multinomial": "pipeline.filter.resampling:multinomial",
        },
        made_of=("config",),
    ),
    Role(
        "init",
        (Method("poses", ("n",), ("rng", "grid", "config")),),
        {
            "exhaustive": "",
            "free_space": "pipeline.filter.initialization:over_free_space",
            "map": "pipeline.filter.initialization:over_map",
            "pose": "pipeline.filter.initialization:around_pose",
        },
        made_of=("grid", "config"),
    ),
)
ROLES: Final[Mapping[str, Role]] = {role.name: role for role in _ROLES}
"""By the name of the parameter."""
OFFERED: Final = frozenset(
    name for role in _ROLES for method in role.methods for name in (*method.offers, *role.made_of)
)
"""Every name by which some part is given something."""
