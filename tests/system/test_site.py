"""The documentation as a site: built without a warning, whole, with notebooks that ran, and nothing from elsewhere."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
import site_pages
from ruamel.yaml import YAML

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))
LOADS = {"script": "src", "img": "src", "iframe": "src", "source": "src", "link": "href"}


def in_nav(entry: Any) -> Iterator[str]:
    """The pages that the navigation names, at any depth."""
    if isinstance(entry, str):
        yield entry
    for below in entry if isinstance(entry, list) else entry.values() if isinstance(entry, dict) else ():
        yield from in_nav(below)


def test_every_page_is_in_the_navigation_once() -> None:
    named = sorted(in_nav(YAML(typ="safe").load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]))
    written = [path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")]
    run = [path.relative_to(DOCS).with_suffix(".md").as_posix() for path in NOTEBOOKS]
    assert named == sorted([*written, *run, *site_pages.PAGES.values()])


@pytest.mark.parametrize(
    ("source", "link", "shown"),
    [
        ("docs/world.md", "[a](verdict.md#b)", "[a](verdict.md#b)"),
        ("docs/tutorials/student.md", "[a](../lessons.md)", "[a](../lessons.md)"),
        ("docs/index.md", "[a](notebooks/first_run.ipynb)", "[a](notebooks/first_run.md)"),
        ("docs/api.md", "[a](../README.md#from-python)", "[a](index.md)"),
        ("docs/tutorials/student.md", "[a](../../CONTRIBUTING.md)", "[a](../contributing.md)"),
        ("docs/own_parts.md", "[ekf.py](../pipeline/filter/ekf.py)", "`pipeline/filter/ekf.py`"),
        ("docs/own_parts.md", "[the converters](../converters/cmu.py)", "the converters (`converters/cmu.py`)"),
        ("CONTRIBUTING.md", "[a](docs/faults.md#b)", "[a](faults.md#b)"),
        ("data/README.md", "![a](../docs/pictures/end.png)", "![a](pictures/end.png)"),
        ("docs/world.md", "[a](https://example.org/b) [c](#d)", "[a](https://example.org/b) [c](#d)"),
    ],
)
def test_links_are_those_of_the_site(source: str, link: str, shown: str) -> None:
    assert site_pages.relinked(link, source) == shown


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_are_kept_without_what_they_showed(notebook: Path) -> None:
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    assert all(not cell["outputs"] and cell["execution_count"] is None for cell in cells if cell["cell_type"] == "code")


def test_tutorials_name_commands_and_options_that_there_are() -> None:
    from typer.main import get_command

    from pipeline.cli import app

    commands = getattr(get_command(app), "commands")  # noqa: B009 - that it is a group is known to typer only
    typed = re.compile(r"(?:^    |^\$ |`)mcl ([a-z]+)((?:[^\n`\\]|\\\n)*)", re.M)
    for page in sorted((DOCS / "tutorials").glob("*.md")):
        found = typed.findall(page.read_text(encoding="utf-8"))
        assert found, page.name
        for name, rest in found:
            known = {option for parameter in commands[name].params for option in parameter.opts}
            used = set(re.findall(r"(?:^|\s)(--?[a-z][a-z-]*)", rest))
            assert used <= known, f"{page.name}: mcl {name}{rest}"


class Loaded(HTMLParser):
    """Gathers what a browser fetches to show a page."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        said = dict(attrs)
        if tag in LOADS and said.get("rel") != "canonical":
            self.addresses.append(said.get(LOADS[tag]) or "")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("mkdocs", reason="the site is built with the extra `docs`")
    built = tmp_path_factory.mktemp("site") / "site"
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(built)]
    done = subprocess.run(command, cwd=ROOT, env=os.environ | {"NO_COLOR": "1"}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    return built


def test_every_page_is_built(site: Path) -> None:
    for page in in_nav(YAML(typ="safe").load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]):
        assert (site / page).with_suffix(".html").is_file(), page


def test_nothing_is_loaded_from_other_hosts(site: Path) -> None:
    for page in site.rglob("*.html"):
        text, loaded = page.read_text(encoding="utf-8"), Loaded()
        loaded.feed(text)
        foreign = [address for address in loaded.addresses if re.match(r"(?:\w+:)?//", address)]
        assert not foreign, f"{page.name}: {foreign}"


def test_notebooks_show_what_came_out(site: Path) -> None:
    for notebook in NOTEBOOKS:
        page = (site / "notebooks" / f"{notebook.stem}.html").read_text(encoding="utf-8")
        assert f"{notebook.stem}_" in page, "no picture"
        assert (site / "notebooks" / notebook.name).is_file(), "a reader may want to run it"
    assert "100%" in (site / "notebooks" / "comparing_filters.html").read_text(encoding="utf-8")


def test_docstrings_of_public_names_are_there(site: Path) -> None:
    import pipeline

    page = (site / "reference.html").read_text(encoding="utf-8")
    for module, name in pipeline._HOMES.values():
        assert f'id="{module}.{name}"' in page
