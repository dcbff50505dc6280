"""Where the parameters stand in the text of a ROS 2 parameter file, to the character."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from pipeline.errors import MclError
from pipeline.nav2.given import KEY, NODE, Given, is_amcl, of_the_filter
from pipeline.yaml_errors import yaml_told

_INTEGER: Final = re.compile(r"[-+]?(0|[1-9][0-9]*|0x[0-9a-fA-F]+|0[0-7]+)")
_DOUBLE: Final = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_TRUE: Final = ("y", "Y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON")
_FALSE: Final = ("n", "N", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF")


@dataclass(frozen=True)
class Entry:
    """One parameter: its dotted ``name``, the span ``start`` to ``end`` of its value in the text, and its ``line``.

    ``value``: as ROS reads it, which takes more words for true and false than YAML does. ``single``: not a list.
    ``anchor``: the name by which other lines refer to this value; ``colon``: where its value may begin.
    """

    name: str
    value: Any
    line: int
    start: int
    end: int
    colon: int
    single: bool = True
    anchor: str = ""


@dataclass
class Block:
    """The parameters of one node: its ``entries``, and where and how another line is added.

    ``indent``: columns before a name. ``inside``: where the braces end, if the parameters stand in braces.
    """

    node: str
    line: int
    end: int
    indent: int
    inside: int | None = None
    entries: dict[str, Entry] = field(default_factory=dict)


@dataclass(frozen=True)
class Layout:
    """The text of a file, its ``blocks`` by node, where its last line of content ends, and its end of line.

    ``aliases``: the anchors that some line refers to. ``braces``: all of it stands in braces.
    """

    text: str
    path: Path | str
    blocks: dict[str, Block]
    end: int
    aliases: frozenset[str]
    braces: bool

    @property
    def newline(self) -> str:
        """How its lines end."""
        return "\r\n" if "\r\n" in self.text else "\n"


def layout_of(text: str, path: Path | str) -> Layout:
    """Raises MclError, with the line, for what is no single YAML document with a mapping."""
    from ruamel.yaml import YAML

    with yaml_told(path):
        events = list(YAML(typ="safe", pure=True).parse(text))
    kinds = [type(event).__name__ for event in events]
    if kinds.count("DocumentStartEvent") > 1:
        raise MclError("several documents in one file", "nav2 reads one: leave one of them", path=path)
    if "MappingStartEvent" not in kinds[:3]:
        raise MclError("expected a mapping of nodes", path=path)
    reader = _Reader(text, events[2:])
    reader.mapping([], None)
    aliases = frozenset(str(event.anchor) for event in events if type(event).__name__ == "AliasEvent")
    return Layout(text, path, reader.blocks, reader.last, aliases, bool(events[2].flow_style))


def load(text: str, path: Path | str) -> Any:
    """What YAML makes of the text. Raises MclError, with the line where there is one, for what is none."""
    from ruamel.yaml import YAML

    with yaml_told(path):
        return YAML(typ="safe", pure=True).load(text)


class _Reader:
    """Goes through the events of the parser, and knows at each where in the file it is."""

    def __init__(self, text: str, events: list[Any]) -> None:
        self._text, self._events, self._at = text, events, 0
        self.blocks: dict[str, Block] = {}
        self.last = 0

    def mapping(self, keys: list[str], block: Block | None) -> None:
        """A mapping below these keys, in the parameters of a node or outside of them."""
        self._next()
        while not self._is("MappingEndEvent"):
            if not self._is("ScalarEvent"):
                self._skip()
                self._skip()
                continue
            key = self._next()
            self._value([*keys, str(key.value)], key, block)
        end = self._next()
        if block is not None and not keys and end.end_mark.index > end.start_mark.index:
            block.inside = end.start_mark.index

    def _value(self, keys: list[str], key: Any, block: Block | None) -> None:
        colon = self._text.find(":", key.end_mark.index) + 1
        if block is None and keys[-1] == KEY:
            self._parameters("/".join(part.strip("/") for part in keys[:-1]) or NODE, key, colon)
        elif self._is("MappingStartEvent"):
            self.mapping(keys, block)
        else:
            event = self._events[self._at]
            single = self._is("ScalarEvent") or self._is("AliasEvent")
            start = event.start_mark.index
            self._skip()
            end = self._events[self._at - 1].end_mark.index
            if block is not None:
                plain = self._is_plain(event)
                text = str(getattr(event, "value", ""))
                value: Any = (typed(text) if plain else text) if single else []
                anchor = str(event.anchor or "") if type(event).__name__ == "ScalarEvent" else ""
                name, line = ".".join(keys), key.start_mark.line + 1
                # The value of `name:` is told to stand at the next key; it belongs behind the colon.
                where = (colon, colon) if start == end else (start, end)
                block.entries[name] = Entry(name, value, line, where[0], where[1], colon, single, anchor)
                self.last = max(self.last, where[1])
                block.end = max(block.end, where[1])
            elif start < end:
                self.last = max(self.last, end)

    def _parameters(self, node: str, key: Any, colon: int) -> None:
        block = Block(node, key.start_mark.line + 1, colon, key.start_mark.column + 2)
        self.blocks[node] = block
        self.last = max(self.last, colon)
        if self._is("MappingStartEvent"):
            first = self._events[self._at + 1]
            if type(first).__name__ == "ScalarEvent" and first.start_mark.line > key.start_mark.line:
                block.indent = first.start_mark.column
            self.mapping([], block)
            self.last = max(self.last, block.end, block.inside or 0)
        else:
            self._skip()

    def _is(self, kind: str) -> bool:
        return type(self._events[self._at]).__name__ == kind

    @staticmethod
    def _is_plain(event: Any) -> bool:
        return type(event).__name__ == "ScalarEvent" and event.style is None

    def _next(self) -> Any:
        self._at += 1
        return self._events[self._at - 1]

    def _skip(self) -> None:
        """One whole node."""
        depth = 0
        while True:
            kind = type(self._next()).__name__
            depth += kind in ("MappingStartEvent", "SequenceStartEvent")
            depth -= kind in ("MappingEndEvent", "SequenceEndEvent")
            if depth == 0:
                return


def typed(text: str) -> Any:
    """A plain scalar as ROS 2 reads it."""
    if text in ("", "~", "null", "Null", "NULL"):
        return None
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    if _INTEGER.fullmatch(text):
        sign, digits = (-1 if text[0] == "-" else 1), text.lstrip("+-")
        base = 16 if digits[:2] == "0x" else 8 if digits[0] == "0" else 10
        return sign * int(digits, base)
    if _DOUBLE.fullmatch(text):
        return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    return text


def given_of_layout(layout: Layout) -> Given:
    """What the file gives AMCL, every value as ROS reads it; nothing, if AMCL is not in it.

    Raises MclError if there are several.
    """
    found = [node for node in layout.blocks if is_amcl(node)]
    if len(found) > 1:
        raise MclError(f"parameters of several AMCL nodes: {', '.join(found)}", "keep one of them", path=layout.path)
    return Given(layout.path, {name: entry.value for name, entry in _entries(layout)})


def lines_of(layout: Layout) -> dict[str, int]:
    """On which line each of AMCL's parameters stands."""
    return {name: entry.line for name, entry in _entries(layout)}


def _entries(layout: Layout) -> Iterator[tuple[str, Entry]]:
    """Those given to every node, if AMCL has them, and then its own."""
    for node, block in layout.blocks.items():
        if "*" in node and not is_amcl(node):
            yield from ((name, entry) for name, entry in block.entries.items() if of_the_filter(name))
    for node, block in layout.blocks.items():
        if is_amcl(node):
            yield from block.entries.items()
