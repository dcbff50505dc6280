"""Whole processes as a user starts them: start-up, recording and all."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from pipeline.bench.measure import Row, row


def commands(log: Path, repeats: int) -> list[Row]:
    """Rows of ``mcl`` in processes of its own."""
    mcl = [sys.executable, "-m", "pipeline.cli"]
    rows = [row("mcl --help", "s", [_run([*mcl, "--help"])[0] for _ in range(repeats + 1)][1:])]
    for particles, beams in ((500, 36), (2000, 60)):
        name = f"mcl localize, {particles} particles x {beams} beams"
        given = ["localize", str(log), "--particles", str(particles), "--set", f"max_beams={beams}"]
        recorded, bare, peaks, writing = [], [], [], []
        with tempfile.TemporaryDirectory() as folder:
            for k in range(repeats + 1):
                wall, peak = _run([*mcl, *given, "-o", f"{folder}/{k}"])
                recorded.append(wall)
                parts = json.loads(Path(folder, str(k), "run.json").read_text(encoding="utf-8"))["seconds"]
                writing.append(parts["record"] + parts["close"])
                peaks.append(peak)
                bare.append(_run([*mcl, *given, "--no-record", "-o", f"{folder}/bare{k}"])[0])
        rows.append(row(name, "s", recorded[1:]))
        less = [a - b for a, b in zip(recorded, bare, strict=True)]
        rows.append(row(f"{name}: for the recording", "s", less[1:]))
        rows.append(row(f"{name}: writing it, once rerun is loaded", "s", writing[1:]))
        if any(peaks):
            rows.append(row(f"{name}: peak memory", "MB", peaks[1:]))
    return rows


def _run(command: Sequence[str]) -> tuple[float, float]:
    """Seconds, and MB at most, of a process; 0 MB where the system does not tell."""
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    assert process.stderr is not None
    told = process.stderr.read()
    peak = 0.0
    if hasattr(os, "wait4"):
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        peak = usage.ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
    if process.wait():
        raise subprocess.CalledProcessError(process.returncode, list(command), stderr=told)
    return time.perf_counter() - start, peak
