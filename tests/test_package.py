"""What `from pipeline import ...` offers: by these names, whatever was imported before, and nothing heavy before it is
used."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import pipeline

NAMES = sorted(pipeline.__all__)
ROOT = Path(pipeline.__file__).parents[1]


def run(program: str) -> str:
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_importing_the_package_loads_nothing_heavy() -> None:
    run("""
import sys
import pipeline
heavy = sorted({"numba", "rerun", "scipy", "matplotlib", "rosbags", "pydantic", "numpy", "typer"} & set(sys.modules))
assert not heavy, heavy
from pipeline import Config, load_map, localize, read_log
heavy = sorted({"numba", "rerun", "scipy", "matplotlib"} & set(sys.modules))
assert not heavy, heavy
""")


@pytest.mark.parametrize("name", NAMES)
def test_every_name_is_there_and_calls_what_it_says(name: str) -> None:
    assert name in dir(pipeline)
    assert callable(getattr(pipeline, name))


def test_submodules_imported_before_do_not_take_a_names_place() -> None:
    run("""
import pipeline.localization, pipeline.config, pipeline.logs.reader, pipeline.replay, pipeline.cli, converters.cached
from pipeline import Config, load_map, localize, read_log
assert localize is pipeline.localization.localize
assert read_log is converters.cached.read_log
assert Config is pipeline.config.Config
assert load_map is converters.read_map
""")


def test_no_submodule_has_the_name_of_something_offered() -> None:
    """The import system would put the module in its place."""
    folder = Path(pipeline.__file__).parent
    assert not {path.stem for path in folder.iterdir()} & set(NAMES)


def test_what_is_not_there_is_no_attribute() -> None:
    with pytest.raises(AttributeError, match="no attribute 'teleport'"):
        _ = pipeline.teleport
    assert not hasattr(pipeline, "_repr_html_")


def test_the_stub_offers_the_same_names() -> None:
    stub = ast.parse(Path(pipeline.__file__).with_suffix(".pyi").read_text())
    (offered,) = (
        ast.literal_eval(node.value)
        for node in stub.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    )
    assert sorted(offered) == NAMES


def test_who_cites_it_cites_this_version() -> None:
    from ruamel.yaml import YAML

    cited = YAML(typ="safe").load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert str(cited["version"]) == pipeline.__version__
    assert (cited["title"], cited["license"]) == (project["name"], project["license"])
    assert cited["cff-version"] == "1.2.0"
    assert all(cited[key] for key in ("message", "authors"))


def test_every_package_it_needs_is_told_with_its_licence() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = {re.match(r"[\w.-]+", text)[0] for text in project["dependencies"]}
    page = (ROOT / "docs" / "licences.md").read_text(encoding="utf-8")
    told = dict(re.findall(r"^\| ([\w.-]+) \| ([^|]+) \|", page, re.M))
    assert needed <= set(told)
    assert all(told[name].strip() for name in needed)


def test_a_shell_can_complete_it() -> None:
    """What `mcl --show-completion` adds to a shell asks `mcl` itself, by its name, and gets an answer."""
    done = subprocess.run(
        [sys.executable, "-c", "import sys; sys.argv[0] = 'mcl'; from pipeline.cli import main; main()"],
        capture_output=True, text=True, cwd=ROOT,
        env={"_MCL_COMPLETE": "complete_bash", "COMP_WORDS": "mcl localize --require", "COMP_CWORD": "2", "PATH": ""},
    )  # fmt: skip
    assert done.stdout.split() == ["--require-found"], done.stderr
