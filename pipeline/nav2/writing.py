"""AMCL's parameters written into a file of nav2's: every other line stays as it is, to the byte."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.errors import MclError
from pipeline.nav2.given import is_amcl, nodes_in
from pipeline.nav2.layout import Block, Layout, layout_of, load
from pipeline.nav2.parameters import PARAMETERS

Values = Mapping[str, Any]


def fresh(values: Values, comment: str = "") -> str:
    """A file of its own with these parameters of AMCL and nothing else; ``comment``: lines at its head."""
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    return f"{head}{_node(values, chr(10))}"


def written(text: str, values: Values, path: Path | str) -> str:
    """The ``text`` of a parameter file in which AMCL has these values; a parameter that it lacks is added below.

    Raises MclError if the file has several AMCL, or a value that cannot be replaced without changing another line.
    """
    layout = layout_of(text, path)
    found = [node for node in layout.blocks if is_amcl(node)]
    if len(found) > 1:
        raise MclError(f"parameters of several AMCL nodes: {', '.join(found)}", "keep one of them", path=path)
    changes = [_appended(layout, values)] if not found else _changes(layout, layout.blocks[found[0]], values)
    for start, end, new in sorted(changes, reverse=True):
        text = text[:start] + new + text[end:]
    _check(layout.text, text, values, path)
    return text


def _changes(layout: Layout, block: Block, values: Values) -> list[tuple[int, int, str]]:
    """What to put in place of which span."""
    out = []
    for name, value in values.items():
        entry = block.entries.get(name)
        if entry is None:
            continue
        if not entry.single or entry.anchor in layout.aliases:
            why = f"the anchor &{entry.anchor}, to which other lines refer" if entry.single else "a list or a mapping"
            raise MclError(f"{name} has {why}", "give it a number of its own", path=layout.path, line=entry.line)
        if entry.value == value and type(entry.value) is type(value):
            continue  # it says so already, in its own spelling
        new = PARAMETERS[name].written(value)
        anchor = f"&{entry.anchor} " if entry.anchor else ""
        out.append((entry.start, entry.end, f" {new}" if entry.start == entry.colon else anchor + new))
    missing = {name: value for name, value in values.items() if name not in block.entries}
    return [*out, _added(layout, block, missing)] if missing else out


def _added(layout: Layout, block: Block, values: Values) -> tuple[int, int, str]:
    pairs = [f"{name}: {PARAMETERS[name].written(value)}" for name, value in values.items()]
    if block.inside is not None:
        return block.inside, block.inside, f"{', ' if block.entries else ''}{', '.join(pairs)}"
    lines = [" " * block.indent + pair for pair in pairs]
    return _below(layout, block.end, lines)


def _appended(layout: Layout, values: Values) -> tuple[int, int, str]:
    if layout.braces:
        raise MclError("a file in braces that has no AMCL", "add `amcl: {ros__parameters: {}}`", path=layout.path)
    return _below(layout, layout.end, _node(values, "\n").splitlines())


def _below(layout: Layout, at: int, lines: list[str]) -> tuple[int, int, str]:
    """Lines that follow the one with the character ``at``."""
    text, newline = layout.text, layout.newline
    end = text.find("\n", at)
    if end < 0:
        return len(text), len(text), "".join(newline + line for line in lines)
    return end + 1, end + 1, "".join(line + newline for line in lines)


def _node(values: Values, newline: str) -> str:
    pairs = (f"    {name}: {PARAMETERS[name].written(value)}" for name, value in values.items())
    return newline.join(["amcl:", "  ros__parameters:", *pairs, ""])


def _check(before: str, after: str, values: Values, path: Path | str) -> None:
    """Raises MclError unless the new text reads as the old one does, but for these values."""
    old, new = _read(before, path), _read(after, path)
    wanted = dict(old)
    for node in [name for name in new if is_amcl(name)]:
        wanted[node] = old.get(node, {}) | {name: repr(value) for name, value in values.items()}
    if new != wanted:
        raise MclError("this file is written in a way that cannot be changed safely", "write it plainly", path=path)


def _read(text: str, path: Path | str) -> dict[str, dict[str, str]]:
    """Every value of every node, in Python's words, in which 12 is not 12.0 and a NaN is itself."""
    values = load(text, path)
    return {node: {name: repr(value) for name, value in below.items()} for node, below in nodes_in(values or {})}
