"""docs/parameters.md says of every parameter what the program says, and of every one of AMCL's what becomes of it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from pipeline import nav2
from pipeline.config import Config
from pipeline.explained import SYMBOLS, UNITS

PAGE = (Path(__file__).resolve().parents[1] / "docs" / "parameters.md").read_text(encoding="utf-8")
OURS, _, AMCLS = PAGE.partition("## AMCL's parameter files")
AMCLS = AMCLS.partition("### AMCL of ROS 1")[0]
SCHEMA = Config.model_json_schema()["properties"]


def rows(text: str) -> dict[str, list[str]]:
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:3] == "| `"]
    return {row[0].strip("`"): row for row in cells}


def kind(schema: dict[str, Any]) -> str:
    if "anyOf" in schema:
        return f"{kind(schema['anyOf'][0])} or null"
    if "enum" in schema:
        return "choice"
    if schema.get("type") == "array" and "enum" in schema.get("items", {}):
        return "list"
    return {"boolean": "yes or no", "array": "3 numbers", "object": "by name"}.get(schema["type"], schema["type"])


def bounds(schema: dict[str, Any]) -> str:
    one = schema["anyOf"][0] if "anyOf" in schema else schema
    if "enum" in one:
        return ", ".join(one["enum"])
    if one["type"] == "object":
        return "-"
    if one["type"] == "array":
        if "items" in one:
            return ", ".join(one["items"]["enum"])
        one = one["prefixItems"][0]
    least, most = one.get("minimum"), one.get("maximum")
    if most is not None:
        return f"{least:g} to {most:.0f}"
    if least is not None:
        return f">= {least:g}"
    return f"> {one['exclusiveMinimum']:g}" if "exclusiveMinimum" in one else "-"


def test_every_parameter_has_its_row_in_the_order_that_tells_the_story() -> None:
    assert list(rows(OURS)) == list(Config.model_fields)


@pytest.mark.parametrize("name", Config.model_fields)
def test_a_row_says_what_the_program_says(name: str) -> None:
    _, said_kind, unit, symbol, said_bounds, default, meaning = rows(OURS)[name]
    assert unit == UNITS.get(name, "-")
    assert symbol.strip("`") == SYMBOLS.get(name, "-")
    assert said_kind == kind(SCHEMA[name])
    assert said_bounds == bounds(SCHEMA[name])
    value = YAML(typ="safe").load(default)
    assert value == (list(d) if isinstance(d := Config.model_fields[name].default, tuple) else d)
    description = str(Config.model_fields[name].description)
    for told in ("m", "rad", "1/m", "rad^2/rad^2", "rad^2/m^2", "m^2/m^2", "m^2/rad^2"):
        if description.endswith(f", {told}."):
            assert unit == told
    assert meaning.endswith(".")


def test_every_parameter_of_amcl_has_its_row() -> None:
    assert list(rows(AMCLS)) == sorted(nav2.PARAMETERS)


@pytest.mark.parametrize("name", nav2.PARAMETERS)
def test_a_row_says_what_becomes_of_it(name: str) -> None:
    parameter = nav2.PARAMETERS[name]
    _, said_kind, said_bounds, default, here, said = rows(AMCLS)[name]
    word = re.split(r"[:;]", said)[0]
    assert said_kind == parameter.kind
    assert said_bounds == (", ".join(f"`{c}`" for c in parameter.choices) or parameter.bounds or "-")
    assert YAML(typ="safe").load(default) == parameter.default
    assert here.strip("`") == (parameter.here or "-")
    if not parameter.here and not parameter.translated:
        assert word == "absent"
    else:
        assert word in ("same", "different")
        assert here == "-" or here.strip("`") in Config.model_fields
