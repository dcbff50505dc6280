"""A run that is stopped half-way leaves a recording that is whole as far as it goes, and no traceback."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from commands import Command, Journey


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_stopped_run_can_be_inspected(
    sent: signal.Signals, code: int, mcl: Command, journey: Journey, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    slow = ("--set", "max_particles=300000", "--set", "record_particles=200", "--set", "recovery=none")
    command = [sys.executable, "-m", "pipeline.cli", "localize", str(journey.log), *slow, "-o", str(folder)]
    # Its own group: a Ctrl-C of the test's must not end the tests.
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        wait_for_a_batch(folder / "run.rrd", process)
        os.kill(process.pid, sent)
        stdout, stderr = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == code, stderr
    assert stdout == ""
    assert "Traceback" not in stderr
    assert f"recorded until then: {folder / 'run.rrd'}" in stderr
    assert {path.name for path in folder.iterdir()} == {"run.rrd", "config.yaml"}
    told = json.loads(mcl("inspect", folder, "--json").stdout)
    assert told["damage"] is None
    assert 0 < told["scans"] < told["log_scans"]


def test_a_run_stopped_at_once_leaves_nothing(journey: Journey, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    command = [sys.executable, "-m", "pipeline.cli", "localize", str(journey.log), "-o", str(folder)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        while process.poll() is None and not folder.exists():
            time.sleep(0.002)
        os.kill(process.pid, signal.SIGINT)
        _, stderr = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == 130, stderr
    assert "Traceback" not in stderr
    assert "stopped; nothing was recorded" in stderr
    assert not list(tmp_path.iterdir())


PREAMBLE = 600_000
"""Bytes: more than a recording of this map has before the first batch of scans (380,000), and less than with it."""


def wait_for_a_batch(recording: Path, process: subprocess.Popen[str]) -> None:
    """Until the recording has grown past its preamble: the run is in the middle of the log then."""
    while process.poll() is None:
        if recording.exists() and recording.stat().st_size > PREAMBLE:
            return
        time.sleep(0.02)
    raise AssertionError("the run ended before it could be stopped")
