"""Rerun's own viewer: where it is installed, how it is started, and its files for the web."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Sequence
from pathlib import Path

from pipeline.errors import MclError

PATIENCE = 60.0
"""Seconds that a local server may take to answer."""


def program() -> Path:
    """The viewer that was installed with rerun-sdk, whose version is that of the recordings. MclError without one."""
    beside = Path(sys.executable).with_name("rerun.exe" if os.name == "nt" else "rerun")
    found = beside if beside.exists() else shutil.which("rerun")
    if found is None:
        raise MclError("rerun's viewer is not installed", "pip install rerun-sdk")
    return Path(found)


def quiet() -> dict[str, str]:
    """The environment in which rerun neither sends nor writes anything about its use."""
    return os.environ | {"CI": "1"}


def start(arguments: Sequence[str | Path], *, wait: bool) -> int:
    """Start the viewer; ``wait`` until it is closed and return its exit code, else 0 at once."""
    command = [program(), *arguments]
    if wait:
        return subprocess.run(command, env=quiet(), check=False).returncode
    subprocess.Popen(
        command, env=quiet(), start_new_session=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    return 0


def web_files() -> tuple[str, bytes]:
    """The viewer for browsers: its JavaScript and its WebAssembly. They lie within the program, which serves them.

    Raises MclError if it does not.
    """
    port, web_port = _free_port(), _free_port()
    served = subprocess.Popen(
        [program(), "--serve-web", "--bind", "127.0.0.1", "--port", str(port), "--web-viewer-port", str(web_port)],
        env=quiet(), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        address = f"http://127.0.0.1:{web_port}"
        return _fetch(f"{address}/re_viewer.js", served).decode("utf-8"), _fetch(f"{address}/re_viewer_bg.wasm", served)
    finally:
        served.terminate()
        served.wait()


def _fetch(address: str, served: subprocess.Popen[bytes]) -> bytes:
    until = time.monotonic() + PATIENCE
    direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    while True:
        try:
            with direct.open(address, timeout=PATIENCE) as answer:
                return bytes(answer.read())
        except (urllib.error.URLError, OSError) as error:
            if served.poll() is not None or time.monotonic() > until or isinstance(error, urllib.error.HTTPError):
                raise MclError(f"rerun's viewer for browsers cannot be had from its program: {error}") from error
            time.sleep(0.1)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
