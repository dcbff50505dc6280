"""What the project promises of its own shape: layers, docstrings, sizes, names, a quick --help, no machine's paths."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = [ROOT / "pipeline", ROOT / "converters"]
SOURCES = sorted(path for package in PACKAGES for path in package.rglob("*.py"))
LONGEST = 400  # lines
VAGUE = re.compile(
    r"(?:^|_)(?:util|utils|utility|utilities|helper|helpers|manager|managers|misc|common|stuff)(?:_|$)", re.I
)
# A home folder, or a top-level folder that only one machine has.
ONE_MACHINES_PATH = re.compile(r"(?<![\w.~}/-])/(?:home|Users|root|work|workspace|mnt)/\w")


def named(path: Path) -> str:
    return str(path.relative_to(ROOT))


def tracked() -> list[Path]:
    try:
        listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    return [ROOT / name for name in listed.stdout.split("\0") if name and (ROOT / name).is_file()]


def public(body: list[ast.stmt], prefix: str = "") -> Iterator[tuple[str, ast.AST]]:
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield prefix + node.name, node
            if isinstance(node, ast.ClassDef):
                yield from public(node.body, f"{prefix}{node.name}.")


def test_imports_keep_to_their_layers() -> None:
    """The contracts stand in pyproject.toml; what breaks one is in the output."""
    program = "import sys; from importlinter.cli import lint_imports_command; sys.exit(lint_imports_command())"
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 broken" in done.stdout


@pytest.mark.parametrize("path", SOURCES, ids=named)
def test_everything_public_has_a_docstring(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    bare = [name for name, node in public(tree.body) if not ast.get_docstring(node)]  # type: ignore[arg-type]
    if tree.body and not ast.get_docstring(tree):
        bare.insert(0, "the module")
    assert not bare


def test_no_module_is_too_long() -> None:
    lengths = {named(path): len(path.read_text(encoding="utf-8").splitlines()) for path in SOURCES}
    assert {name: length for name, length in lengths.items() if length > LONGEST} == {}


def test_no_name_says_nothing() -> None:
    """A module is named for what it knows, not for being of use."""
    vague = [
        named(path) for path in tracked() for part in path.relative_to(ROOT).parts if VAGUE.search(Path(part).stem)
    ]
    for path in SOURCES:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        snake = {name: re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name) for name, _ in public(tree.body)}
        vague += [f"{named(path)}: {name}" for name, spelt in snake.items() if VAGUE.search(spelt)]
    assert vague == []


def test_no_path_of_one_machine_is_written_anywhere() -> None:
    found = []
    for path in tracked():
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except UnicodeDecodeError:
            continue
        found += [
            f"{named(path)}:{number}: {line.strip()[:100]}"
            for number, line in enumerate(lines, start=1)
            if ONE_MACHINES_PATH.search(line) or f"{ROOT}/" in line
        ]
    assert found == []


def test_help_loads_nothing_heavy() -> None:
    """Someone who asks for help does not wait for a compiler and a viewer."""
    program = """
import sys
sys.argv = ["mcl", "--help"]
from pipeline.cli import main
try:
    main()
except SystemExit as done:
    assert not done.code, done.code
heavy = sorted({"numba", "rerun", "scipy", "matplotlib", "rosbags"} & set(sys.modules))
assert not heavy, heavy
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "localize" in done.stdout
