"""A truth of another log or another map is noticed."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from pipeline.logs.messages import Log, Trajectory
from pipeline.logs.plausibility import doubt_truth


def with_truth(log: Log, *, later: float = 0.0, moved: tuple[float, float] = (0.0, 0.0)) -> Log:
    assert log.ground_truth is not None
    truth = log.ground_truth
    poses = truth.poses + np.array([*moved, 0.0])
    return dataclasses.replace(log, ground_truth=Trajectory(truth.stamps + round(later * 1e9), poses))


def test_the_right_truth_raises_no_doubt(office: Log) -> None:
    assert doubt_truth(office) == ""
    assert doubt_truth(with_truth(office, later=20.0, moved=(0.5, 0.5))) == ""
    assert doubt_truth(dataclasses.replace(office, ground_truth=None)) == ""


@pytest.mark.parametrize(("later", "covers"), [(1e6, "0 %"), (-1e6, "0 %"), (65.0, "2[0-9] %")])
def test_a_truth_of_another_time(office: Log, later: float, covers: str) -> None:
    said = doubt_truth(with_truth(office, later=later))
    assert re.match(f"the truth covers {covers} of the scans: it runs from .* s to .* s, the scans from", said), said


def test_a_truth_of_another_place(office: Log) -> None:
    said = doubt_truth(with_truth(office, moved=(200.0, -3.0)))
    assert said.startswith("0 % of the truth (x 2")
    assert said.endswith("is it in the map's frame?")
    assert doubt_truth(dataclasses.replace(with_truth(office, moved=(200.0, 0.0)), grid=None)) == ""
