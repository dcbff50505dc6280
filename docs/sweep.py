"""Runs the tables of docs/localization.md, faults.md and changed_maps.md again, row by row; prints one table of it all.

    python docs/sweep.py [--data DIR] [--seeds 20] [--only TEXT] [--jobs N]      or: make sweep SEEDS=20 DATA=DIR

Rows that are done are kept below ``.sweep/``, one JSON each, under a name that has the row's definition, the number of
seeds and the content of the source in it: whatever ends this early, the same line goes on where it was, and a change of
the source runs everything anew. Rows whose data are not there, or that fail, are told and left out.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import json
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from sweep_rows import Row, rows

from pipeline.evaluate.drift import driven
from pipeline.logs.mcap_file import McapFile
from pipeline.logs.messages import Trajectory
from pipeline.logs.tum import read_tum, write_tum
from pipeline.outputs import replacing

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ("pipeline", "converters")
MCL = [sys.executable, "-m", "pipeline.cli"]
GRACE = 3.0
"""s that a command has to end by itself."""


def main() -> int:
    """Run what is not done yet and print the table; 130 if it was stopped, 1 if a row failed."""
    asked = _asked()
    signal.signal(signal.SIGINT, _stop)  # also where whoever started this in the background has it ignored
    signal.signal(signal.SIGTERM, _stop)
    sweep = Sweep(asked.folder, asked.data, asked.seeds, asked.jobs)
    chosen = [row for row in rows() if asked.only.lower() in row.name.lower()]
    try:
        for number, row in enumerate(chosen, start=1):
            sweep.run(row, f"{number}/{len(chosen)}")
        stopped = False
    except KeyboardInterrupt:
        print("\nstopped; what is done is kept, the same line goes on from here", file=sys.stderr)
        stopped = True
    print(table([(row, found) for row in chosen if (found := sweep.found(row)) is not None]))
    return 130 if stopped else int(bool(sweep.failed))


def _asked() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--data", type=Path, default=ROOT / "../shared/data", help="The folder of the recordings.")
    parser.add_argument("--folder", type=Path, default=ROOT / ".sweep", help="Where logs and results are kept.")
    parser.add_argument("--seeds", type=int, default=20, help="Runs of every row.")
    parser.add_argument("--only", default="", metavar="TEXT", help="Only rows whose name has this in it.")
    parser.add_argument("--jobs", type=int, help="Processes; as many as cores if not given.")
    return parser.parse_args()


class Sweep:
    """Converts and evaluates rows, and remembers in ``folder`` what is done."""

    def __init__(self, folder: Path, data: Path, seeds: int, jobs: int | None) -> None:
        self._data, self._seeds, self._jobs = data.resolve(), seeds, jobs
        self.failed: list[str] = []
        self._source = content(ROOT, SOURCE)
        folder = folder.resolve()
        self._results, self._logs = folder / "results", folder / "logs" / self._source
        if self._logs.parent.is_dir():  # logs that another source converted
            for old in self._logs.parent.iterdir():
                if old != self._logs:
                    shutil.rmtree(old, ignore_errors=True)
        self._results.mkdir(parents=True, exist_ok=True)
        self._logs.mkdir(parents=True, exist_ok=True)

    def run(self, row: Row, where: str) -> None:
        """Evaluates the row, unless that is done."""
        file = self._result(row)
        missing = [name for name in (*row.logs, row.map, *row.truth) if not self._path(name).exists()]
        if file.exists():
            told = "done before"
        elif missing:
            told = f"left out: {missing[0]} is not there"
        else:
            print(f"{where}  {row.name} ...", file=sys.stderr, flush=True)
            told = self._evaluate(row, file)
        print(f"{where}  {row.name}: {told}", file=sys.stderr, flush=True)

    def found(self, row: Row) -> dict[str, Any] | None:
        """What came out of the row, as `mcl evaluate --json` tells it of its only log; None if it is not done."""
        file = self._result(row)
        if not file.exists():
            return None
        (log,) = json.loads(file.read_text(encoding="utf-8"))["logs"].values()
        return dict(log)

    def _evaluate(self, row: Row, file: Path) -> str:
        log, truth = self._converted(row), self._logs / f"{_slug(row.name)}.tum"
        if isinstance(log, str):
            self.failed.append(row.name)
            return f"failed: {log}"
        _write_truth(truth, [read_tum(self._path(name)) for name in row.truth], log)
        command = [*MCL, "evaluate", str(log), "--reference", str(truth), "--runs", str(self._seeds), "--json"]
        command += [*row.evaluate, *(["--map", str(self._path(row.map_now))] if row.map_now else [])]
        command += ["--jobs", str(self._jobs)] if self._jobs else []
        code, answer = _run(command)
        if code:
            self.failed.append(row.name)
            return "failed, as said above"
        if content(ROOT, SOURCE) != self._source:
            raise SystemExit("the source has changed meanwhile, and this row is of neither; run it again")
        with replacing(file) as partial:
            partial.write_text(answer, encoding="utf-8")
        told = self.found(row)
        return "done" if told is None else f"{told['successes']} of {told['runs']} succeed"

    def _converted(self, row: Row) -> Path | str:
        """The row's log as an .mcap, or what is wrong."""
        output = self._logs / f"{_slug(row.name)}.mcap"
        if output.exists():
            return output
        sources = [self._path(name) for name in row.logs]
        if row.thin is not None:
            sources = [_thinned(sources[0], self._path(row.truth[0]), row.thin, output.with_suffix(".log"))]
        command = [*MCL, "convert", *map(str, sources), "--map", str(self._path(row.map)), "-o", str(output)]
        done = subprocess.run([*command, *row.convert], cwd=ROOT, capture_output=True, text=True)
        return output if not done.returncode else (done.stderr.strip().splitlines() or ["no reason given"])[-1]

    def _path(self, name: str) -> Path:
        return (ROOT / "data" if name.startswith("sample/") else self._data) / name

    def _result(self, row: Row) -> Path:
        key = hashlib.sha256(f"{row} {self._seeds} {self._source}".encode()).hexdigest()[:12]
        return self._results / f"{_slug(row.name)}-{key}.json"


def _run(command: list[str]) -> tuple[int, str]:
    """Exit code and answer of a command. Who stops this stops that as well, which then ends its own processes."""
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        try:
            answer, _ = process.communicate()
        except BaseException:
            try:
                process.wait(GRACE)  # Ctrl-C in a terminal reaches both
            except subprocess.TimeoutExpired:
                process.terminate()
                process.wait(10 * GRACE)
            raise
    return process.returncode, answer


def _stop(*_: object) -> None:
    raise KeyboardInterrupt


def content(root: Path, packages: Iterable[str]) -> str:
    """A short checksum of all files of these packages: their names below ``root``, and what is in them."""
    total = hashlib.sha256()
    for package in packages:
        for path in sorted((root / package).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                total.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return total.hexdigest()[:12]


def _slug(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")


def _write_truth(path: Path, truths: Sequence[Trajectory], log: Path) -> None:
    """The truth at the stamps of the log: where logs were joined, those after the first were moved in time."""
    with McapFile(log) as file:
        segments = [json.loads(text) for text in file.metadata().get("mcl:segments", {}).values()]
    shifts = {segment["source"]: int(segment["stamp_shift"]) for segment in segments}
    stamps = np.concatenate([truth.stamps + shifts.get(k, 0) for k, truth in enumerate(truths)])
    write_tum(path, Trajectory(stamps, np.concatenate([truth.poses for truth in truths])))


def _thinned(source: Path, truth: Path, metres: float, output: Path) -> Path:
    """A CARMEN log with a scan per so many metres of the true path, which has a pose for every scan, in their order."""
    path = driven(read_tum(truth).poses)
    chosen = np.flatnonzero(np.diff(np.floor(path / metres), prepend=-1.0) > 0)
    lines = gzip.decompress(source.read_bytes()).decode("latin-1").splitlines(keepends=True)
    scans = [number for number, line in enumerate(lines) if line.startswith("FLASER")]
    if len(scans) != len(path):
        raise SystemExit(f"{truth}: {len(path)} poses, {len(scans)} scans in {source}")
    left_out = set(scans) - {scans[k] for k in chosen.tolist()}
    kept = (line for number, line in enumerate(lines) if number not in left_out)
    output.write_text("".join(kept), encoding="latin-1")
    return output


# --- the table ------------------------------------------------------------------------------------------------------

COLUMNS = (
    "log",
    "success",
    "found after, median and p95 (s)",
    "scans right (%)",
    "position error since, median / p95 (m)",
    "heading, median / p95 (deg)",
    "ATE (m)",
    "false alarms",
    "times real time",
    "found again after being carried off",
    "found again after faults, in two scans",
)


def table(found: Sequence[tuple[Row, dict[str, Any]]]) -> str:
    """The rows in Markdown, under COLUMNS."""
    lines = [COLUMNS, ("---", *["---:"] * (len(COLUMNS) - 1))]
    for row, log in found:
        again = [
            f"{each['recovered']}/{log['runs']}" + (f" after {_pair(each['time'], ' ', 1)} s" if each["time"] else "")
            for each in log["recoveries"]
        ]
        lines.append(
            (
                row.name,
                f"{log['successes']}/{log['runs']}",
                _pair(log["time_to_localize"], " ", 1),
                _median(log["scans_right"], 1, 100.0),
                _pair(log["position_error"], " / ", 3),
                _pair(log["heading_error"], " / ", 1),
                _median(log["ate"], 2),
                str(log["false_alarms"]),
                f"{log['speed']:.0f}",
                ", ".join(again) or "-",
                ", ".join(_after(fault) for fault in log.get("faults", ())) or "-",
            )
        )
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _after(fault: dict[str, Any]) -> str:
    seconds = f" after {_pair(fault['time'], ' ', 1)} s" if fault["time"] else ""
    return f"{fault['fault']}: {fault['found_again']}/{fault['times']}{seconds}, {fault['at_once']}/{fault['times']}"


def _pair(summary: dict[str, float] | None, between: str, digits: int) -> str:
    if summary is None:
        return "-"
    return f"{summary['median']:.{digits}f}{between}{summary['p95']:.{digits}f}"


def _median(summary: dict[str, float] | None, digits: int, scale: float = 1.0) -> str:
    return "-" if summary is None else f"{scale * summary['median']:.{digits}f}"


if __name__ == "__main__":
    sys.exit(main())
