"""AMCL's parameters in a launch file: ROS 1's, or the XML of ROS 2.

Only what the file plainly says is taken: parameters of the one node of AMCL, with the defaults of its arguments put
in. It is read by a parser that opens nothing else: a document type, in which entities would be declared, is refused,
and so is a file that is larger than any launch file is.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from xml.parsers import expat

from pipeline.errors import MclError
from pipeline.nav2.given import KEY, NODE

LARGEST: Final = 1_000_000
"""Characters."""
DEEPEST: Final = 64
"""Tags within tags."""
PACKAGES: Final = {"amcl": 1, "nav2_amcl": 2}
"""Package of the node -> which ROS it is of."""
TRUE: Final = {"true": True, "1": True, "false": False, "0": False}
_SUBSTITUTION: Final = re.compile(r"\$\(([^()]*)\)")


@dataclass
class Tag:
    """A tag of the file, the ``line`` on which it begins, its ``text``, and what is ``within`` it."""

    name: str
    given: Mapping[str, str]
    line: int
    text: str = ""
    within: list[Tag] = field(default_factory=list)


def is_launch(text: str) -> bool:
    """Whether this is XML, which no YAML begins like."""
    return text.lstrip("\ufeff \t\r\n").startswith("<")


def values_of_launch(text: str, path: Path | str, remark: Callable[[str], object]) -> dict[str, Any]:
    """What a YAML file with the same parameters would hold. What depends on something else is told to ``remark``.

    Raises MclError, with the line, for what is no launch file, has no AMCL in it, or several.
    """
    root = _parsed(text, path)
    if root.name != "launch":
        raise MclError(f"expected a launch file, got XML of <{root.name}>", path=path, line=root.line)
    walk = _Walk(path, remark)
    found = list(walk.nodes(root, {}))
    if len(found) > 1:
        raise MclError("several nodes of AMCL", "keep one of them", path=path, line=found[1][0].line)
    if not found:
        others = any(tag.name == "include" for tag in _all(root))
        hint = "the files that it includes are not read: give the one with the node of AMCL" if others else ""
        raise MclError("no node of AMCL in this launch file", hint, path=path)
    node, arguments = found[0]
    values = dict(walk.parameters(node, arguments))
    return {NODE: values if PACKAGES[node.given["pkg"]] == 1 else {KEY: values}}


class _Walk:
    """Goes through a launch file as roslaunch would, as far as the file alone tells the way."""

    def __init__(self, path: Path | str, remark: Callable[[str], object]) -> None:
        self._path, self._remark = path, remark

    def nodes(self, tag: Tag, arguments: dict[str, str]) -> Iterator[tuple[Tag, dict[str, str]]]:
        """Every node of AMCL with the arguments that hold there."""
        for inner in tag.within:
            if not self._holds(inner, arguments):
                continue
            if inner.name in ("arg", "let"):
                said = inner.given.get("value", inner.given.get("default"))
                if said is not None and (value := self._put_in(said, arguments)) is not None:
                    arguments[inner.given.get("name", "")] = value
            elif inner.name == "group":
                yield from self.nodes(inner, dict(arguments))
            elif inner.name == "node" and inner.given.get("pkg") in PACKAGES:
                yield inner, dict(arguments)

    def parameters(self, node: Tag, arguments: Mapping[str, str]) -> Iterator[tuple[str, Any]]:
        """The node's parameters by name."""
        for tag in node.within:
            if not self._holds(tag, arguments):
                continue
            name = tag.given.get("name", tag.given.get("param", ""))
            if tag.name == "param" and name:
                said = tag.given.get("value")
                value = None if said is None else self._put_in(said, arguments)
                if value is None:
                    self._tell(tag, f"{name} is not taken: its value stands in another place")
                else:
                    yield name, _typed(value, tag.given.get("type", "auto"), self._path, tag.line)
            elif tag.name == "rosparam" and "file" not in tag.given:
                yield from self._inner_yaml(tag, name, arguments)
            elif tag.name in ("param", "rosparam"):
                said = tag.given.get("file", tag.given.get("from", ""))
                self._tell(tag, f"the parameters in {said} are not read; give that file itself")
            elif tag.name == "remap" and tag.given.get("from") == "scan":
                yield "scan_topic", self._put_in(tag.given.get("to", "scan"), arguments) or "scan"

    def _inner_yaml(self, tag: Tag, name: str, arguments: Mapping[str, str]) -> Iterator[tuple[str, Any]]:
        text: str | None = tag.text
        if tag.given.get("subst_value", "").lower() in ("true", "1"):
            text = self._put_in(tag.text, arguments)
        if text is None:
            self._tell(tag, "<rosparam> is not taken: its text depends on something else")
            return
        values = _yaml(text, self._path, tag.line)
        if name:
            yield name, values
        elif isinstance(values, Mapping):
            yield from ((str(key), value) for key, value in values.items())

    def _holds(self, tag: Tag, arguments: Mapping[str, str]) -> bool:
        """Whether ``if`` and ``unless`` let the tag count; one that cannot be decided does not."""
        for word, wanted in (("if", True), ("unless", False)):
            if word not in tag.given:
                continue
            said = self._put_in(tag.given[word], arguments)
            decided = None if said is None else TRUE.get(said.strip().lower())
            if decided is None:
                self._tell(tag, f"<{tag.name} {word}=...> is left out: it depends on something else")
            if decided is not wanted:
                return False
        return True

    def _put_in(self, text: str, arguments: Mapping[str, str]) -> str | None:
        """The text with the arguments' values, None if it asks for anything else."""
        whole = True

        def value(match: re.Match[str]) -> str:
            nonlocal whole
            word, _, name = match[1].strip().partition(" ")
            if word not in ("arg", "var") or name.strip() not in arguments:
                whole = False
                return ""
            return arguments[name.strip()]

        out = _SUBSTITUTION.sub(value, text)
        return out if whole and len(out) <= LARGEST else None

    def _tell(self, tag: Tag, text: str) -> None:
        self._remark(f"{self._path}:{tag.line}: {text}")


def _parsed(text: str, path: Path | str) -> Tag:
    if len(text) > LARGEST:
        raise MclError("this launch file is too large to be one", path=path)
    parser = expat.ParserCreate()
    top = Tag("", {}, 0)
    open_tags = [top]

    def start(name: str, given: dict[str, str]) -> None:
        if len(open_tags) > DEEPEST:
            raise MclError("tags are nested too deeply", path=path, line=parser.CurrentLineNumber)
        open_tags.append(Tag(name, given, parser.CurrentLineNumber))
        open_tags[-2].within.append(open_tags[-1])

    def data(said: str) -> None:
        open_tags[-1].text += said

    def end(_: str) -> None:
        open_tags.pop()

    def refuse(*_: Any) -> None:
        raise MclError("a launch file has no document type", "leave it out", path=path, line=parser.CurrentLineNumber)

    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, data
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    parser.buffer_text = True
    try:
        parser.Parse(text.lstrip("\ufeff \t\r\n"), True)
    except expat.ExpatError as error:
        raise MclError(f"not XML: {expat.ErrorString(error.code)}", path=path, line=error.lineno) from error
    except (ValueError, UnicodeError) as error:  # an encoding that is none
        raise MclError(f"not XML: {error}", path=path) from error
    return top.within[0]


def _all(tag: Tag) -> Iterator[Tag]:
    for inner in tag.within:
        yield inner
        yield from _all(inner)


def _typed(text: str, kind: str, path: Path | str, line: int) -> Any:
    """A value as roslaunch reads it: by its type, or as the number or truth that it looks like."""
    try:
        if kind in ("int", "double"):
            return int(text) if kind == "int" else float(text)
        if kind in ("bool", "boolean"):
            return TRUE[text.strip().lower()]
    except (ValueError, KeyError) as error:
        raise MclError(f"expected {kind}, got {text!r}", path=path, line=line) from error
    if kind in ("str", "string"):
        return text
    if kind == "yaml":
        return _yaml(text, path, line)
    for read in (int, float):
        try:
            return read(text)
        except ValueError:
            continue
    return {"true": True, "false": False}.get(text.strip().lower(), text)


def _yaml(text: str, path: Path | str, line: int) -> Any:
    from ruamel.yaml import YAML

    try:
        return YAML(typ="safe").load(text)
    except Exception as error:  # YAMLError, and what Python cannot hold
        raise MclError("what stands there is not YAML", path=path, line=line) from error
