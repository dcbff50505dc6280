"""Puts a page together: its markup, style and script in one file, and the rule that nothing else may run in it."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any

COLOURS = "page.css"
"""The colours of every page, by day, by night and in print."""


def filled(name: str, *, title: str, styles: Sequence[str], scripts: Sequence[str], parts: Mapping[str, str]) -> str:
    """The page of this name with its files in place, and ``parts`` (markup) by their marks.

    Its Content-Security-Policy knows style and script by their hashes: what a name or a text smuggles in does not run,
    and nothing is fetched from anywhere.
    """
    style = "\n".join(_file(part) for part in (COLOURS, *styles))
    script = "\n".join(['"use strict";', *(_file(part) for part in scripts)])
    rules = {"default-src": "'none'", "script-src": _hash(script), "style-src": _hash(style), "img-src": "data:"}
    marks = {
        "@TITLE@": html.escape(title),
        "@RULES@": "; ".join(f"{kind} {allowed}" for kind, allowed in rules.items()),
        "@STYLE@": style,
        "@SCRIPT@": script,
        **{f"@{mark}@": part for mark, part in parts.items()},
    }
    # All at once: what is put in may itself look like one of the marks.
    return re.sub("|".join(marks), lambda mark: marks[mark[0]], _file(name))


def as_json(value: Any) -> str:
    """For a script element: what might end it is spelt otherwise."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _file(name: str) -> str:
    return resources.files("pipeline.share").joinpath(name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode('ascii')}'"
