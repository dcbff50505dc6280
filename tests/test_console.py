"""Progress is a line now and then where nobody looks, and nothing for what is soon done."""

import itertools

import pytest

from pipeline import console


@pytest.fixture
def clock(monkeypatch):
    """A clock that goes on by two seconds whenever it is read."""
    ticks = itertools.count(100.0, 2.0)
    monkeypatch.setattr(console.time, "monotonic", lambda: next(ticks))


def test_lines_come_every_five_seconds_at_most(clock, capsys):
    assert list(console.progress("abcdefghijkl", 12, "drawing")) == list("abcdefghijkl")
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.splitlines() == [
        "drawing: 2 of 12, about 30 s left",
        "drawing: 5 of 12, about 17 s left",
        "drawing: 8 of 12, about 9 s left",
        "drawing: 11 of 12, about 2 s left",
    ]


def test_what_is_soon_done_says_nothing(capsys):
    assert list(console.progress(range(1000), 1000, "drawing")) == list(range(1000))
    assert capsys.readouterr().err == ""


def test_items_are_taken_one_by_one(clock, capsys):
    taken = []
    for item in console.progress((taken.append(k) or k for k in range(3)), 3, "drawing"):
        assert taken[-1] == item
