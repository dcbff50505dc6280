"""Whatever ends an evaluation: its processes end too, and nothing is left in the folder for temporary files."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks for processes in /proc")

SCRIPT = """
import sys; sys.path[:0] = {path!r}
import test_pool as t
from pipeline.evaluate.pool import spread
if __name__ == '__main__':
    list(spread(t.says_who_it_is_and_sleeps, None, range(3), 2))
"""


def says_who_it_is_and_sleeps(_: None, task: int) -> None:
    tempfile.mkdtemp(prefix="of-a-task-")
    os.write(1, f"{os.getpid()}\n".encode())  # in one piece, whoever else writes
    time.sleep(600)


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.parametrize(
    "number",
    [pytest.param(signal.SIGKILL, marks=pytest.mark.slow, id="SIGKILL"), pytest.param(signal.SIGTERM, id="SIGTERM")],
)
def test_who_is_killed_leaves_nothing(tmp_path, number):
    here = Path(__file__)
    script = SCRIPT.format(path=[str(here.parent), str(here.parents[2])])
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, env=environment, start_new_session=True
    ) as process:
        try:
            assert process.stdout is not None
            workers = [int(process.stdout.readline()) for _ in range(2)]
            assert len(list(tmp_path.glob("mcl-evaluate-*/of-a-task-*"))) == 2
            os.kill(process.pid, number)  # it alone, as an out-of-memory killer does
            process.wait(timeout=30)
            end = time.monotonic() + 30
            while (any(map(alive, workers)) or any(tmp_path.iterdir())) and time.monotonic() < end:
                time.sleep(0.05)
            assert not any(map(alive, workers))
            assert list(tmp_path.iterdir()) == []
        finally:
            for pid in (process.pid, *workers):
                if alive(pid):
                    os.kill(pid, signal.SIGKILL)
