"""What is published can be installed: an sdist that builds a wheel, and a wheel that finds the robot, far from here."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import pytest

import pipeline

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 570
"""No step takes longer; whoever waits for an index that does not answer shall not wait for ever."""


def run(*command: str | Path, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """A command that knows nothing of this checkout."""
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(
        [str(word) for word in command],
        cwd=cwd, env=clean | environment, capture_output=True, text=True, timeout=SECONDS,
    )  # fmt: skip


def fresh(folder: Path, *sites: str) -> Path:
    """An environment without anything in it but what lies in ``sites``; returns its Python."""
    made = run(sys.executable, "-m", "venv", folder, cwd=folder.parent)
    assert made.returncode == 0, made.stderr
    (site,) = folder.glob("lib/python*/site-packages")
    # Folders on the path, whose own .pth files are not followed: so this checkout, if it is installed, is not there.
    (site / "dependencies.pth").write_text("".join(f"{path}\n" for path in sites), encoding="utf-8")
    return folder / "bin" / "python"


def spare_compiling(kernels: Path) -> None:
    """What was compiled here serves there, where the sources are the same: numba knows them by their size and time."""
    for source in (ROOT / "pipeline" / "kernels").glob("*.py"):
        there = kernels / source.name
        assert there.read_bytes() == source.read_bytes()
        os.utime(there, ns=(source.stat().st_atime_ns, source.stat().st_mtime_ns))
    (kernels / "__pycache__").mkdir(exist_ok=True)
    for compiled in (ROOT / "pipeline" / "kernels" / "__pycache__").glob("*.nb[ic]"):
        shutil.copy2(compiled, kernels / "__pycache__")


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The sdist of this checkout, and the wheel that is built from nothing but that."""
    folder = tmp_path_factory.mktemp("built")
    builder = fresh(folder / "builder")
    got = run(builder, "-m", "pip", "install", "--quiet", "hatchling>=1.25", cwd=folder)
    if got.returncode:
        pytest.skip(f"pip reaches no index to get hatchling from: {got.stderr.strip().splitlines()[-1:]}")
    done = run(builder, "-m", "hatchling", "build", "--target", "sdist", "--directory", folder, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    (sdist,) = folder.glob("*.tar.gz")
    done = run(
        builder, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", folder, sdist,
        cwd=folder,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (wheel,) = folder.glob("*.whl")
    return sdist, wheel


def test_the_wheel_has_all_that_runs_and_the_sdist_all_that_builds(built: tuple[Path, Path]) -> None:
    sdist, wheel = built
    with zipfile.ZipFile(wheel) as file:
        packed = set(file.namelist())
    here = {
        path.relative_to(ROOT).as_posix()
        for package in ("pipeline", "converters")
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert here <= packed
    assert {"pipeline/py.typed", "converters/py.typed", "pipeline/sample/building.yaml"} <= packed
    assert any(name.endswith("licenses/LICENSE") for name in packed)
    assert not {name.split("/")[0] for name in packed} - {
        "pipeline", "converters", f"mcl_replay-{pipeline.__version__}.dist-info"
    }  # fmt: skip
    with tarfile.open(sdist) as archive:
        sources = {name.partition("/")[2] for name in archive.getnames()}
    assert {"LICENSE", "README.md", "CITATION.cff", "CHANGELOG.md", "pyproject.toml"} <= sources
    assert not [name for name in sources if name.endswith((".mcap", ".rrd", ".pyc")) or name.startswith(".venv")]


def test_installed_alone_it_finds_the_robot(built: tuple[Path, Path], tmp_path: Path) -> None:
    """In an environment that has the dependencies and this wheel, and from a folder that has nothing."""
    python = fresh(tmp_path / "alone", sysconfig.get_path("purelib"), sysconfig.get_path("platlib"))
    done = run(python, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", built[1], cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    where = run(
        python, "-c", "import pipeline, converters; print(pipeline.__file__, converters.__file__)", cwd=elsewhere
    )
    assert all(path.startswith(str(tmp_path / "alone")) for path in where.stdout.split()), where.stdout + where.stderr
    mcl = python.with_name("mcl")
    told = run(mcl, "--version", cwd=elsewhere)
    assert told.stdout.strip() == f"mcl-replay {pipeline.__version__}"
    assert run(python, "-m", "pipeline", "--version", cwd=elsewhere).stdout == told.stdout
    spare_compiling(Path(where.stdout.split()[0]).parent / "kernels")
    demo = run(mcl, "demo", cwd=elsewhere, MCL_CACHE_DIR=str(tmp_path / "cache"))
    assert demo.returncode == 0, demo.stderr
    (folder,) = [Path(line) for line in demo.stdout.splitlines() if line]
    assert "true: found" in demo.stderr
    for name in ("run.rrd", "run.json", "trajectory.tum"):
        assert (elsewhere / folder / name).stat().st_size > 1000
