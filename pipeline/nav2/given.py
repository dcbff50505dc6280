"""What a parameter file says of AMCL, by the names that nav2 has: from nav2's own YAML, or from that of ROS 1."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from pipeline.errors import MclError
from pipeline.nav2 import ros1
from pipeline.nav2.parameters import DEFAULTS, LARGEST, OF_EVERY_NODE, PARAMETERS

KEY: Final = "ros__parameters"
"""Below this key are the parameters of a ROS 2 node, in any of its parameter files."""
NODE: Final = "amcl"


@dataclass(frozen=True)
class Given:
    """AMCL's parameters as a file gives them, by nav2's names.

    ``values``: what it gives, also what AMCL does not know; ``defaults``: what AMCL takes for the rest, nav2's or ROS
    1's; ``names``: what the file calls a parameter, where that is another name than nav2's; ``own``: values of
    parameters of this program that only ROS 1 has; ``remarks``: a line each on what was not taken.
    """

    path: Path | str
    values: Mapping[str, Any]
    defaults: Mapping[str, Any] = field(default_factory=lambda: DEFAULTS)
    names: Mapping[str, str] = field(default_factory=dict)
    own: Mapping[str, Any] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def name(self, name: str) -> str:
        """What the file calls it."""
        return self.names.get(name, name)

    def get(self, name: str) -> Any:
        """The value of one of AMCL's parameters."""
        return self.values.get(name, self.defaults[name])

    def number(self, name: str) -> float:
        """Raises MclError unless it is one."""
        value = self.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LARGEST:
            raise MclError(f"{self.name(name)}: expected a number, got {value!r}", path=self.path)
        return float(value)

    def flag(self, name: str) -> bool:
        """Raises MclError unless it is true or false."""
        value = self.get(name)
        if not isinstance(value, bool):
            raise MclError(f"{self.name(name)}: expected true or false, got {value!r}", path=self.path)
        return value

    def one_of(self, name: str, choices: Mapping[str, Any]) -> str:
        """Raises MclError unless it is one of these words."""
        value = str(self.get(name))
        if value not in choices:
            known = ", ".join(choices)
            raise MclError(f"{self.name(name)}: expected one of {known}, got {self.get(name)!r}", path=self.path)
        return value

    def unknown(self) -> list[str]:
        """Names that AMCL does not know, nor any node."""
        beside = (*OF_EVERY_NODE, *(ros1.ABSENT if self.names else ()))
        return [n for n in self.values if n not in PARAMETERS and n.partition(".")[0] not in beside]

    def ignored(self) -> Iterator[str]:
        """A line that names what has no meaning here, if there is anything."""
        told = [self.name(n) for n in self.values if n in PARAMETERS and not of_the_filter(n)]
        told += [n for n in self.values if self.names and n in ros1.ABSENT]
        if unknown := self.unknown():
            told.append(f"and what AMCL does not know: {', '.join(unknown)}")
        if told:
            yield f"{self.path}: parameters of AMCL; ignored: {', '.join(told)}"


def of_the_filter(name: str) -> bool:
    """Whether the parameter of AMCL has a meaning here."""
    return name in PARAMETERS and bool(PARAMETERS[name].here or PARAMETERS[name].translated)


def given_in(values: Mapping[Any, Any], path: Path | str) -> Given | None:
    """AMCL's part of a YAML file of ROS, of which it may be the only one; None if the file is none of ROS.

    Raises MclError if a file of ROS has no AMCL, or more than one.
    """
    if nodes := dict(nodes_in(values)):
        return Given(path, _of_amcl(nodes, path))
    below = values.get(NODE)
    if isinstance(below, Mapping):
        return _of_ros1(dict(flat(below)), path)
    return _of_ros1(dict(values), path) if ros1.ONLY & values.keys() else None


def nodes_in(values: Mapping[Any, Any], namespace: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Every node of a file of ROS 2 with its parameters by their dotted names; nodes may stand in namespaces."""
    for key, below in values.items():
        if key == KEY:
            yield namespace or NODE, dict(flat(below if isinstance(below, Mapping) else {}))
        elif isinstance(below, Mapping):
            yield from nodes_in(below, f"{namespace}/{str(key).strip('/')}".lstrip("/"))


def flat(values: Mapping[Any, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Parameters by their dotted names."""
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def is_amcl(node: str) -> bool:
    """Whether a node is AMCL, in whatever namespace."""
    return node.rpartition("/")[2] == NODE


def _of_amcl(nodes: Mapping[str, Mapping[str, Any]], path: Path | str) -> dict[str, Any]:
    """AMCL's parameters by their dotted names: those of the node, over those given to every node."""
    found = [name for name in nodes if is_amcl(name)]
    every = {name: value for node in nodes if "*" in node for name, value in nodes[node].items() if of_the_filter(name)}
    if len(found) > 1:
        raise MclError(f"parameters of several AMCL nodes: {', '.join(found)}", "keep one of them", path=path)
    if not found and not every:
        raise MclError(f"no parameters of {NODE!r} in this ROS file: it has {', '.join(nodes)}", path=path)
    return every | dict(nodes[found[0]] if found else {})


def _of_ros1(values: Mapping[str, Any], path: Path | str) -> Given:
    taken = ros1.taken(values)
    return Given(path, taken.values, ros1.DEFAULTS, ros1.NAMES, taken.own, tuple(f"{path}: {r}" for r in taken.remarks))
