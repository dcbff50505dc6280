"""The types of what is offered are complete: a user's script is checked as strictly as mypy can."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import pipeline

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = Path(__file__).with_name("users_script.py")
STRICT = ("--strict", "--follow-imports=silent", "--no-error-summary", "--config-file=")
"""Only the script is judged, and by nobody's configuration: what the package is made of is judged by `make lint`."""


def checked(script: Path, cache: Path) -> str:
    command = [sys.executable, "-m", "mypy", *STRICT, f"--cache-dir={cache}", str(script)]
    environment = {**os.environ, "MYPYPATH": str(ROOT)}
    done = subprocess.run(command, cwd=cache, env=environment, capture_output=True, text=True)
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("mypy")


def test_a_users_script_passes(cache: Path) -> None:
    assert checked(SCRIPT, cache) == ""


def test_what_is_wrong_in_one_is_found(cache: Path, tmp_path: Path) -> None:
    """So the types are known, and not Any: for Any nothing would be wrong."""
    wrong = tmp_path / "wrong.py"
    wrong.write_text(
        "import pipeline as mcl\n"
        "log = mcl.read_log(3)\n"
        "mcl.localize(log, seed='three')\n"
        "n: str = mcl.localize(log).poses\n"
        "for step in mcl.Localizer(log):\n"
        "    step.particels\n"
        "mcl.evaluate_logs(log).logs[0].success_rate.upper()\n"
        "mcl.read_run('x').told.pose_at('noon')\n"
        "mcl.Config(sigma_hit='wide')\n"
        "mcl.Config(sigma_hti=0.2)\n"
    )
    lines = {int(line.split(":")[1]) for line in checked(wrong, cache).splitlines() if ": error:" in line}
    assert lines == {2, 3, 4, 6, 7, 8, 9, 10}


def test_the_script_uses_every_name() -> None:
    tree = ast.parse(SCRIPT.read_text(encoding="utf-8"))
    used = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "mcl"
    }
    assert used == set(pipeline.__all__)


def test_the_marks_that_say_that_there_are_types_are_there() -> None:
    assert (ROOT / "pipeline" / "py.typed").exists()
    assert (ROOT / "converters" / "py.typed").exists()
