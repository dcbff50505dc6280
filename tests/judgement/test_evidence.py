"""Evidence is counted by spots of wall, each once."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.judgement.evidence import FAMILIAR, MOST_PER_SPOT, SPOT, Evidence

HERE = np.array([0.5, 0.5])


def ends(*spots: int) -> np.ndarray:
    """Beams that end in the middle of these spots, one row of them to the east."""
    return np.array([((spot + 0.5) * SPOT, 0.5) for spot in spots])


def contest(rivals: int = 1) -> Evidence:
    evidence = Evidence()
    evidence.admit(rivals)
    return evidence


def test_a_spot_counts_once_however_often_it_is_seen() -> None:
    evidence = contest()
    for _ in range(10_000):
        evidence.enter(np.array([[-3.0], [-2.5]]), ends(0), HERE, 1.0)
    assert evidence.leads() == pytest.approx([0.0, 0.5], abs=1e-3)


def test_new_spots_add_up() -> None:
    evidence = contest()
    for spot in range(300):  # more than the accounts were made for
        evidence.enter(np.array([[-3.0] * 50, [-2.5] * 50]), ends(*[spot] * 50), HERE, 1.0)
    assert evidence.leads()[1] == pytest.approx(300 * 0.5 * 50 / (50 + FAMILIAR))


def test_one_wrong_spot_cannot_decide() -> None:
    evidence = contest()
    for _ in range(1000):
        evidence.enter(np.array([[-100.0, -1.0], [-1.0, -1.3]]), ends(0, 1), HERE, 1.0)
    assert evidence.leads()[1] == pytest.approx(MOST_PER_SPOT - 0.3, abs=0.01)


def test_a_few_beams_are_believed_by_half() -> None:
    evidence = contest()
    evidence.enter(np.array([[-3.0] * 4, [-2.5] * 4]), ends(0, 0, 0, 0), HERE, FAMILIAR / 4)
    assert evidence.leads()[1] == pytest.approx(0.25)


def test_beams_without_return_are_booked_on_the_floor() -> None:
    evidence = contest()
    nothing = np.full((2, 2), np.nan)
    for x in (0.5, 0.5, SPOT + 0.5):
        evidence.enter(np.array([[-4.0, -4.0], [-3.5, -3.5]]), nothing, np.array([x, 0.5]), 1e6)
    assert evidence.leads()[1] == pytest.approx(2 * 0.5, abs=1e-3)


def test_who_joins_late_is_level_with_the_belief() -> None:
    evidence = contest()
    for _ in range(100):
        evidence.enter(np.array([[-3.0], [-2.5]]), ends(0), HERE, 1.0)
    evidence.admit(1)
    assert evidence.leads()[2] == 0.0
    for _ in range(100):  # on a spot that the others have long known it counts as much as on a new one
        evidence.enter(np.array([[-3.0], [-3.0], [-2.2]]), ends(0), HERE, 1.0)
    assert evidence.leads()[2] == pytest.approx(0.8 * 100 / (100 + FAMILIAR))


def test_the_winner_becomes_the_measure() -> None:
    evidence = contest(2)
    for spot in range(5):
        evidence.enter(np.array([[-3.0], [-2.5], [-2.9]]), ends(spot), HERE, 1e9)
    evidence.keep(np.array([1, 2, 0]))
    assert evidence.leads() == pytest.approx([0.0, -2.0, -2.5])
