"""The page of a look: one file that loads nothing, with nothing of the log's in it unescaped."""

from __future__ import annotations

import html.parser
from pathlib import Path

import numpy as np

from pipeline.check.findings import Finding
from pipeline.check.looking import Report
from pipeline.check.page import page, verdict
from pipeline.check.recording import SeenTopic

EVIL = "/<script>alert(1)</script>\x1b[31m\u202e@FACTS@"


class Tags(html.parser.HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.seen: list[tuple[str, list[tuple[str, str | None]]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, attrs))


def tags(text: str) -> list[tuple[str, list[tuple[str, str | None]]]]:
    parser = Tags()
    parser.feed(text)
    parser.close()
    return parser.seen


def report(name: str = "/scan") -> Report:
    times = np.concatenate([np.arange(0, 10, 0.1), np.arange(30, 40, 0.1)])
    topics = (SeenTopic(name, "sensor_msgs/msg/LaserScan", 200, times), SeenTopic("/camera", "Image", 3))
    findings = (
        Finding("broken", "laser", f"it is {name}", "mend it", (12.0, 28.0)),
        Finding("noted", "map", "there is none", "nothing"),
    )
    return Report(Path(name.replace("/", "_")), (("laser", name),), topics, findings, 40.0, 0.0)


def test_it_loads_nothing_and_draws_the_gap() -> None:
    text = page(report())
    seen = tags(text)
    assert not [attrs for _, attrs in seen if {"src", "href", "onload"} & {name for name, _ in attrs}]
    assert "default-src 'none'" in text
    red = [dict(attrs) for tag, attrs in seen if tag == "rect" and dict(attrs)["fill"] == "#b3261e"]
    assert len(red) == 2  # the silence, and the finding with a time
    gap, mark = red
    assert float(gap["width"] or 0) > float(mark["width"] or 0) > 100
    assert "20.1 s without a message" in text
    assert verdict(report().findings) == "1 broken, 1 noted"
    assert verdict([]) == "nothing was found"


def test_names_of_the_log_are_text_there_and_nothing_else() -> None:
    text, plain = page(report(EVIL)), page(report())
    assert [tag for tag, _ in tags(text)] == [tag for tag, _ in tags(plain)]
    assert "\x1b" not in text
    assert "\u202e" not in text
    assert "\\x1b[31m\\u202e@FACTS@" in text  # a mark in a name is not filled in
