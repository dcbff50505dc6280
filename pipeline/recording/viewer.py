"""Rerun's own viewer: where it is installed, how it is started, and its files for the web."""

from __future__ import annotations

import importlib.util
import os
import re
import socket
import subprocess
import tempfile
import time
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path

from pipeline.errors import MclError

PATIENCE = 60.0
"""Seconds that a local server may take to answer."""
SETTLED = 1.0
"""Seconds after which a viewer that cannot draw has given up."""
DEFAULT_PORT = 9876
NO_SCREEN = "`mcl share` and `mcl export` need none"


def program() -> Path:
    """The viewer that was installed with rerun-sdk, whose version is that of the recordings. MclError without one.

    Not the `rerun` on the PATH: that one only starts this one, and would leave it behind when it is ended.
    """
    package = importlib.util.find_spec("rerun_cli")
    for place in (package.submodule_search_locations or ()) if package else ():
        for name in ("Rerun.app/Contents/MacOS/Rerun", "rerun", "rerun.exe"):
            if (Path(place) / name).is_file():
                return Path(place) / name
    raise MclError("rerun's viewer is not installed", "pip install rerun-sdk")


def quiet() -> dict[str, str]:
    """The environment in which rerun neither sends nor writes anything about its use."""
    return os.environ | {"CI": "1"}


def show(path: Path) -> None:
    """Open a recording in a viewer on this screen and wait until it is closed. Raises MclError if it does not open."""
    told = subprocess.run(
        [program(), "--bind", "127.0.0.1", "--port", "auto", path], env=quiet(), stderr=subprocess.PIPE, check=False
    )
    if told.returncode:
        raise _not_opened(told.stderr)


def open_empty() -> str:
    """Open a viewer on this screen that stays, and return the address to send to. Raises MclError if none opens."""
    port = _free_port()
    with tempfile.TemporaryFile() as said:
        viewer = subprocess.Popen(
            [program(), "--bind", "127.0.0.1", "--port", str(port), "--expect-data-soon"],
            env=quiet(), start_new_session=True, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=said,
        )  # fmt: skip
        until = time.monotonic() + PATIENCE
        while not _listens("127.0.0.1", port, 0.2):
            if viewer.poll() is not None or time.monotonic() > until:
                said.seek(0)
                raise _not_opened(said.read())
            time.sleep(0.1)
        time.sleep(SETTLED)  # it listens before it knows whether there is a screen
        if viewer.poll() is not None:
            said.seek(0)
            raise _not_opened(said.read())
    return f"rerun+http://127.0.0.1:{port}/proxy"


def check_address(address: str) -> None:
    """Raises MclError unless ``address`` is that of a viewer and something listens there."""
    try:
        parts = urllib.parse.urlsplit(address)
        host, port = parts.hostname, parts.port or DEFAULT_PORT
    except ValueError:
        host, port, parts = None, 0, urllib.parse.urlsplit("")
    if not host or parts.scheme not in ("rerun", "rerun+http", "rerun+https") or parts.path != "/proxy":
        raise MclError(f"{address!r} is no address of a viewer", f"expected rerun+http://HOST:{DEFAULT_PORT}/proxy")
    if not _listens(host, port, 5.0):
        raise MclError(f"no viewer answers at {address}", "`rerun` opens one; it prints its address")


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


def _listens(host: str, port: int, patience: float) -> bool:
    try:
        with socket.create_connection((host, port), timeout=patience):
            return True
    except OSError:
        return False


def _not_opened(said: bytes) -> MclError:
    """Why, by the last line that names an error, without the colours of a terminal and the places in its sources."""
    lines = re.sub(r"\x1b\[[0-9;]*m", "", said.decode("utf-8", "replace")).splitlines()
    telling = [line.strip() for line in lines if "error" in line.lower()] or [line.strip() for line in lines] or [""]
    if re.search(r"DISPLAY|EventLoop", telling[-1]):
        return MclError("the viewer did not open: there is no screen here", NO_SCREEN)
    reason = re.sub(r" at /\S+:\d+", "", telling[-1]) or "it said nothing"
    return MclError(f"the viewer did not open: {reason}", f"it wants a screen; {NO_SCREEN}")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
