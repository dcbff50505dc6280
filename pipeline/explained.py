"""What a parameter takes and what the book calls it: kind, range, unit and symbol."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline.wrong_values import kind_and_range

UNITS: Mapping[str, str] = {
    "initial_pose": "m, m, rad",
    "initial_pose_std": "m, m, rad",
    "grid_d": "m",
    "grid_a": "rad",
    "laser_drift_d": "m",
    "laser_drift_a": "rad",
    "alpha1": "rad^2/rad^2",
    "alpha2": "rad^2/m^2",
    "alpha3": "m^2/m^2",
    "alpha4": "m^2/rad^2",
    "alpha5": "m^2/m^2",
    "laser_min_range": "m",
    "laser_max_range": "m",
    "range_bias": "m",
    "laser_likelihood_max_dist": "m",
    "beam_skip_distance": "m",
    "sigma_hit": "m",
    "lambda_short": "1/m",
    "lambda_long": "1/m",
    "update_min_d": "m",
    "update_min_a": "rad",
}
"""Of those that have one; the others are counts, shares and choices."""
SYMBOLS: Mapping[str, str] = {
    "init": "bel(x_0)",
    "max_particles": "M",
    "kld_err": "ε",
    "kld_z": "z_{1-δ}",
    "motion_model": "p(x_t ∣ u_t, x_{t-1})",
    "alpha1": "α_1",
    "alpha2": "α_2",
    "alpha3": "α_3",
    "alpha4": "α_4",
    "max_beams": "K",
    "laser_max_range": "z_max",
    "sensor_model": "p(z_t ∣ x_t, m)",
    "z_hit": "z_hit",
    "z_short": "z_short",
    "z_max": "z_max (its weight)",
    "z_rand": "z_rand",
    "sigma_hit": "σ_hit",
    "lambda_short": "λ_short",
    "ray_caster": "z_t^{k*}",
    "recovery_alpha_slow": "α_slow",
    "recovery_alpha_fast": "α_fast",
}
"""Of those that the book knows, with _ before what stands below and ^ before what stands above."""


def what_is_taken(name: str, schema: Mapping[str, Any]) -> str:
    """Kind, range and unit of a parameter's values, in words; ``schema``: its JSON schema."""
    unit = UNITS.get(name)
    return kind_and_range(schema) + (f" ({unit})" if unit else "")
