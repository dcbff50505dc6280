"""AMCL's parameters are written as nav2 takes them, and nothing else in the file changes."""

from __future__ import annotations

import difflib
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from ruamel.yaml import YAML

from pipeline import nav2
from pipeline.errors import MclError

ROBOT = Path(__file__).with_name("robot.yaml")
LEARNED: dict[str, Any] = {
    "alpha1": 0.031,
    "alpha2": 0.0005,
    "laser_max_range": 12.0,
    "laser_model_type": "likelihood_field",
    "max_beams": 90,
    "max_particles": 3000,
    "z_hit": 0.9,
    "z_rand": 0.1,
}


def amcl(text: str) -> dict[str, Any]:
    found = dict(nav2.nodes_in(YAML(typ="safe").load(text)))
    (node,) = [name for name in found if nav2.is_amcl(name)]
    return found[node]


def scalar(text: str) -> Any:
    """What ROS reads where this stands for a value."""
    block = nav2.layout_of(f"amcl:\n  ros__parameters:\n    sigma_hit: {text}\n", "p").blocks["amcl"]
    return block.entries["sigma_hit"].value


def changed_lines(before: str, after: str) -> list[str]:
    lines = difflib.ndiff(before.splitlines(keepends=True), after.splitlines(keepends=True))
    return [line for line in lines if line[0] in "+-"]


def test_a_whole_file_keeps_every_other_line_to_the_byte() -> None:
    before = ROBOT.read_text()
    after = nav2.written(before, LEARNED, ROBOT)
    assert [line[0] for line in changed_lines(before, after)].count("-") == 7  # the model is said already
    assert len(before.splitlines()) == len(after.splitlines())
    for old, new in zip(before.splitlines(), after.splitlines(), strict=True):
        if old != new:
            name = re.match(r"    (\w+):", old)
            assert name is not None
            assert name[1] in LEARNED
            assert old.partition("#")[1:] == new.partition("#")[1:]  # its comment
    assert amcl(after) == amcl(before) | LEARNED
    assert '    laser_model_type: "likelihood_field"   # or beam, likelihood_field_prob\n' in after
    assert "    alpha1: 0.031          # rotation from rotation\n" in after
    assert "    alpha4:   0.2\n" in after


def test_what_a_file_says_already_stays_in_its_own_spelling() -> None:
    before = ROBOT.read_text()
    assert nav2.written(before, {"alpha2": 0.2, "max_beams": 60, "do_beamskip": False}, ROBOT) == before


def test_writing_twice_is_writing_once() -> None:
    once = nav2.written(ROBOT.read_text(), LEARNED, ROBOT)
    assert nav2.written(once, LEARNED, ROBOT) == once


def test_a_file_with_the_ends_of_line_of_windows_keeps_them() -> None:
    before = ROBOT.read_text().replace("\n", "\r\n")
    after = nav2.written(before, LEARNED | {"random_seed": 3}, ROBOT)
    assert after.count("\r\n") == after.count("\n") == before.count("\n") + 1
    assert amcl(after)["random_seed"] == 3


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (
            "amcl:\n  ros__parameters:\n    alpha1: 0.2\n    # the end\nother: {ros__parameters: {a: 1}}\n",
            "amcl:\n  ros__parameters:\n    alpha1: 0.2\n    sigma_hit: 0.1\n    # the end\n"
            "other: {ros__parameters: {a: 1}}\n",
        ),
        ("amcl:\n  ros__parameters:\n", "amcl:\n  ros__parameters:\n    sigma_hit: 0.1\n"),
        ("amcl:\n  ros__parameters:\n    alpha1: 0.2",
         "amcl:\n  ros__parameters:\n    alpha1: 0.2\n    sigma_hit: 0.1"),
        ("amcl: {ros__parameters: {}}\n", "amcl: {ros__parameters: {sigma_hit: 0.1}}\n"),
        ("amcl: {ros__parameters: {alpha1: 0.2}} # x\n",
         "amcl: {ros__parameters: {alpha1: 0.2, sigma_hit: 0.1}} # x\n"),
        ("a:\n  amcl:\n      ros__parameters:\n            alpha1: 1.0\n",
         "a:\n  amcl:\n      ros__parameters:\n            alpha1: 1.0\n            sigma_hit: 0.1\n"),
        ("/a/amcl:\n  ros__parameters:\n    sigma_hit: 0.3 # m\n",
         "/a/amcl:\n  ros__parameters:\n    sigma_hit: 0.1 # m\n"),
        ("amcl:\n  ros__parameters:\n    sigma_hit:\n    z_hit: 1.0\n",
         "amcl:\n  ros__parameters:\n    sigma_hit: 0.1\n    z_hit: 1.0\n"),
        ("amcl:\n  ros__parameters:\n    sigma_hit:   # m\n    z_hit: 1.0\n",
         "amcl:\n  ros__parameters:\n    sigma_hit: 0.1   # m\n    z_hit: 1.0\n"),
        ("amcl:\n  ros__parameters:\n    sigma_hit: &s 0.3\n", "amcl:\n  ros__parameters:\n    sigma_hit: &s 0.1\n"),
        ("amcl:\n  ros__parameters:\n    z_hit: &s 0.3\n    sigma_hit: *s\n",
         "amcl:\n  ros__parameters:\n    z_hit: &s 0.3\n    sigma_hit: 0.1\n"),
        ("amcl:\n  ros__parameters:\n    initial_pose: {x: 1.0,\n      y: 2.0}\nb:\n  ros__parameters: {}\n",
         "amcl:\n  ros__parameters:\n    initial_pose: {x: 1.0,\n      y: 2.0}\n    sigma_hit: 0.1\n"
         "b:\n  ros__parameters: {}\n"),
        ("amcl:\n  ros__parameters:\n    initial_pose:\n      x: 1.0\n\nb:\n  ros__parameters: {}\n",
         "amcl:\n  ros__parameters:\n    initial_pose:\n      x: 1.0\n    sigma_hit: 0.1\n"
         "\nb:\n  ros__parameters: {}\n"),
        ("b:\n  ros__parameters:\n    c: 1\n# end\n",
         "b:\n  ros__parameters:\n    c: 1\namcl:\n  ros__parameters:\n    sigma_hit: 0.1\n# end\n"),
        ("/**:\n  ros__parameters:\n    sigma_hit: 0.4\n",
         "/**:\n  ros__parameters:\n    sigma_hit: 0.4\namcl:\n  ros__parameters:\n    sigma_hit: 0.1\n"),
        ("amcl:\n  ros__parameters:\n    sigma_hit: 2\n", "amcl:\n  ros__parameters:\n    sigma_hit: 0.1\n"),
    ],
)  # fmt: skip
def test_a_parameter_is_put_where_it_belongs(before: str, after: str) -> None:
    assert nav2.written(before, {"sigma_hit": 0.1}, "p.yaml") == after


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "a:\n  amcl: {ros__parameters: {}}\nb:\n  amcl: {ros__parameters: {}}\n",
            "several AMCL nodes: a/amcl, b/amcl",
        ),
        (
            "amcl:\n  ros__parameters:\n    sigma_hit: &s 0.3\n    z_hit: *s\n",
            r"p\.yaml:3: sigma_hit has the anchor &s",
        ),
        ("amcl:\n  ros__parameters:\n    sigma_hit: [0.1]\n", r"p\.yaml:3: sigma_hit has a list"),
        ("{b: {ros__parameters: {c: 1}}}\n", "a file in braces"),
        ("amcl: [\n", r"p\.yaml:\d"),
        ("a: 1\n---\nb: 2\n", "several documents"),
        ("- 1\n", "expected a mapping"),
        ("", "expected a mapping"),
        ("amcl:\n  ros__parameters:\n    z_hit: 0.1\n    z_hit: 0.2\n", r"p\.yaml:4: .*duplicate"),
    ],
)
def test_a_file_that_cannot_be_changed_safely_is_refused(text: str, said: str) -> None:
    with pytest.raises(MclError, match=said):
        nav2.written(text, {"sigma_hit": 0.1}, "p.yaml")


def test_a_fresh_file_has_amcl_and_nothing_else() -> None:
    text = nav2.fresh(LEARNED, "Learned.\nFrom a log.")
    assert text.startswith("# Learned.\n# From a log.\namcl:\n  ros__parameters:\n    alpha1: 0.031\n")
    assert YAML(typ="safe").load(text) == {"amcl": {"ros__parameters": LEARNED}}


@given(st.floats(1e-9, 1e6), st.sampled_from([p for p in nav2.PARAMETERS.values() if p.kind == "double"]))
def test_a_double_stays_a_double_that_nav2_takes(value: float, parameter: nav2.Parameter) -> None:
    """rcl's parser takes 1 for an integer, which nav2 refuses, and 1e-1 is a text to some readers of YAML."""
    said = parameter.written(value)
    assert re.fullmatch(r"\d+\.\d+", said)
    assert float(said) == pytest.approx(value, rel=6e-4, abs=1e-12)
    (entry,) = nav2.layout_of(nav2.fresh({parameter.name: value}), "p").blocks["amcl"].entries.values()
    assert isinstance(entry.value, float)


@pytest.mark.parametrize("name", nav2.PARAMETERS)
def test_every_parameter_comes_back_with_its_type(name: str) -> None:
    parameter = nav2.PARAMETERS[name]
    assert not parameter.wrong_type(parameter.default)
    assert not parameter.wrong_value(parameter.default)
    text = nav2.fresh({name: parameter.default})
    (entry,) = nav2.layout_of(text, "p").blocks["amcl"].entries.values()
    assert (entry.name, entry.value, type(entry.value)) == (name, parameter.default, type(parameter.default))
    assert amcl(text)[name] == parameter.default


@given(st.sampled_from(sorted(nav2.PARAMETERS)), st.one_of(st.booleans(), st.integers(), st.floats(), st.text()))
def test_a_value_is_right_by_its_type_and_its_bounds(name: str, value: Any) -> None:
    parameter = nav2.PARAMETERS[name]
    wrong = parameter.wrong_type(value)
    assert bool(wrong) == (type(value) is not type(parameter.default))
    if wrong or isinstance(value, bool | str):
        return
    inside = parameter.least <= value <= parameter.most and not (parameter.above and value == parameter.least)
    assert bool(parameter.wrong_value(value)) == (not inside and value != parameter.off)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1), ("-1", -1), ("0x10", 16), ("010", 8), ("1.", 1.0), (".5", 0.5), ("1e-1", 0.1), ("-1.0", -1.0),
        ("yes", True), ("Off", False), ("true", True), ("~", None), ("1.0m", "1.0m"), (".inf", float("inf")),
    ],
)  # fmt: skip
def test_a_scalar_is_read_as_ros_reads_it(text: str, value: Any) -> None:
    (entry,) = (
        nav2.layout_of(f"amcl:\n  ros__parameters:\n    sigma_hit: {text}\n", "p").blocks["amcl"].entries.values()
    )
    assert entry.value == value
    assert type(entry.value) is type(value)


def test_a_number_in_quotes_is_a_text() -> None:
    assert scalar('"0.2"') == "0.2"
