"""The motion prior of a configuration that differs from the default in a few parameters."""

from __future__ import annotations

from typing import Any

from pipeline.config import Config
from pipeline.motion.models import motion_model
from pipeline.motion.prior import Prior, motion_prior
from pipeline.motion.witnesses import Motion


def prior_of(before: Motion, now: Motion, **settings: Any) -> Prior:
    """The motion prior between two scans."""
    config = Config(**settings)
    return motion_prior(before, now, config, motion_model(config))
