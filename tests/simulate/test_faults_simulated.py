"""Drives simulated with faults: what is written is read back as it was made, and the truth is that of the drive."""

from __future__ import annotations

from pathlib import Path

import buildings
import numpy as np
import pytest

from pipeline.errors import MclError
from pipeline.geometry import between, wrap_angle
from pipeline.logs.faults import noted, parse_fault
from pipeline.logs.reader import read_log
from pipeline.logs.tum import read_tum
from pipeline.simulate import Format, simulate, simulate_log

EVERY = ["gap:4:6", "carried:4:6", "turn:4:90", "slide:4:1", "spin:4:6", "dead:4", "mirrored", "no-reverse",
         "scale:0.7", "restart:4", "late:0.3", "thin:0.5"]  # fmt: skip


@pytest.mark.parametrize("text", EVERY)
@pytest.mark.parametrize("building", [buildings.room(), buildings.spinning()], ids=lambda building: building.name)
def test_what_is_written_is_read_back(building, tmp_path: Path, text: str) -> None:
    from pipeline.simulate.simulation import with_faults

    faults = [parse_fault(text)]
    plain = simulate_log(building, 7)
    made = with_faults(plain, faults)
    report = simulate(building, tmp_path, 7, faults=faults)
    log = read_log(report.log)
    assert (report.format, report.faults) == (Format.mcap, [fault.text for fault in noted(log.metadata)])
    np.testing.assert_array_equal(log.stamps, made.log.stamps)
    np.testing.assert_array_equal(log.ranges, made.log.ranges)
    gone = log.odometry - made.log.odometry
    gone[:, 2] = wrap_angle(gone[:, 2])
    np.testing.assert_allclose(gone, 0.0, atol=1e-6)
    if made.log.sweeps is not None:
        assert log.sweeps is not None
        # In the sweep in which the odometry leaps it is read as it was before: nobody was half-way there.
        other = ~np.isclose(log.sweeps, made.log.sweeps, atol=1e-6).all(axis=1)
        assert np.count_nonzero(other) <= (2 if text.startswith(("turn", "slide", "restart")) else 0)
    truth = read_tum(report.ground_truth)
    np.testing.assert_array_equal(truth.stamps, plain.ground_truth.stamps)
    np.testing.assert_allclose(truth.poses[:, :2], plain.ground_truth.poses[:, :2], atol=1e-9)


def test_faults_say_more_of_the_odometry_than_its_noise() -> None:
    from pipeline.simulate.simulation import with_faults

    plain = simulate_log(buildings.room(), 7)
    wrong = with_faults(plain, [parse_fault("turn:4:90")])
    assert plain.odometry_errors[1] < 0.3 < wrong.odometry_errors[1]
    thin = with_faults(plain, [parse_fault("thin:3")])
    assert thin.odometry_errors[0] < 1.0
    assert with_faults(plain, []) is plain
    steps = between(wrong.scan_odometry[:-1], wrong.scan_odometry[1:])
    assert np.isfinite(steps).all()


def test_what_a_simulation_cannot_make_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(MclError, match=r"cannot hold the note of the faults.*--format mcap"):
        simulate(buildings.room(), tmp_path, 7, Format.cmu, [parse_fault("mirrored")])
    with pytest.raises(MclError, match="only mcl evaluate can make it"):
        simulate(buildings.room(), tmp_path, 7, faults=[parse_fault("jump:4:1")])
    assert not list(tmp_path.iterdir())
