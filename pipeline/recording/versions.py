"""What the run was computed with."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

from pipeline import __version__

PACKAGES = ("numpy", "numba", "scipy", "rerun-sdk")


def versions() -> dict[str, str]:
    """Versions of this project, of Python, and of the libraries that can change a result."""
    found = {"mcl-replay": __version__, "python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "unknown"
    return found
