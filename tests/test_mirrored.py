"""A laser that is mounted upside down, unknown to the log."""

from __future__ import annotations

import dataclasses

import numpy as np

from pipeline.config import Config
from pipeline.localization import localize
from pipeline.logs.messages import Log
from pipeline.mirrored import mirrored


def upside_down(log: Log) -> Log:
    laser = dataclasses.replace(log.laser, angle_min=-float(log.laser.angles[-1]))
    return dataclasses.replace(log, laser=laser, ranges=np.ascontiguousarray(log.ranges[:, ::-1]), sweeps=None)


def late_share(log: Log, config: Config) -> float:
    return float(np.mean(localize(log, config, seed=1).explained[len(log) // 2 :]))


def test_scans_that_are_mirrored_are_told_from_a_wrong_map(office: Log) -> None:
    config, office = Config(), office.part(slice(200))
    wrong = upside_down(office)
    explained = late_share(wrong, config)
    assert explained < 0.5
    assert mirrored(wrong, config, explained)
    assert not mirrored(office, config, late_share(office, config))
