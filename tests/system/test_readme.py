"""What the README shows is what the program does: its commands run, and what they say has the lines that are shown."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from commands import Command

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
CONSOLE = re.findall(r"^```console\n\$ mcl (.*?)\n(.*?)^```$", README, re.M | re.S)
PYTHON = re.findall(r"^```python\n(.*?)^```$", README, re.M | re.S)
QUICK = ((r"--runs \d+", "--runs 2 --set recovery=none"), (r"Config\(sigma_hit=0\.2\)", 'Config(recovery="none")'))


def labels(text: str) -> set[str]:
    """The first words of every line: what follows two spaces are values, which may differ."""
    return {re.sub(r"[\d.]+", "N", re.split(r" {2,}", line.strip())[0]) for line in text.splitlines()}


def quickly(text: str) -> str:
    for slow, quick in QUICK:
        text = re.sub(slow, quick, text)
    return text


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("checkout")
    (folder / "data").symlink_to(ROOT / "data")
    return folder


@pytest.mark.parametrize(("typed", "shown"), CONSOLE, ids=[typed.split()[0] for typed, _ in CONSOLE])
def test_commands_say_what_is_shown(typed: str, shown: str, mcl: Command, checkout: Path) -> None:
    done = mcl(*shlex.split(quickly(typed)), cwd=checkout)
    assert shown.strip()
    assert labels(shown) <= labels(done.stdout + done.stderr)


@pytest.mark.parametrize("program", PYTHON)
def test_python_runs(program: str, mcl: Command, checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not (checkout / "office.mcap").exists():
        sample = "data/sample/office"
        mcl("convert", f"{sample}.log.gz", "--map", f"{sample}.dat.gz", "-o", "office.mcap", cwd=checkout)
    monkeypatch.chdir(checkout)
    exec(compile(quickly(program), "README.md", "exec"), {"__name__": "readme"})


def test_every_link_leads_somewhere() -> None:
    pages = [path for kind in ("*.md", "*.ipynb") for path in (ROOT / "docs").rglob(kind)]
    for page in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *pages):
        for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_every_command_is_described() -> None:
    from pipeline.cli import app

    described = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    for command in app.registered_commands:
        assert command.callback is not None
        assert f"`mcl {command.callback.__name__}" in described


def test_every_file_of_a_run_is_described(mcl: Command, checkout: Path) -> None:
    for path in (checkout / "first-run").iterdir():
        assert f"| `{path.name}`" in README
