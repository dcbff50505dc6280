"""Commands that break down half-way: killed, stopped, on a full disk, in a read-only folder, two at once.

Whatever happens: no half file under a final name, what was there before is still there, no process and no temporary
file is left (but by SIGKILL, which nobody hears), the next run succeeds, and there is one line of error, if any.

    python tests/breakdowns.py --rounds 20 --seed 0
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from pipeline.simulate import sample_dir  # noqa: E402

KEPT = "there before"
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
DISK = 150_000
"""Bytes that a file may have on the disk that is full."""
FEW = ("--particles", "2000", "--set", "record_particles=100", "--set", "recovery=none")
SAMPLE = sample_dir()


@dataclass(frozen=True)
class Broken:
    """A command: its name, what is typed, and the ``outputs`` that it makes."""

    name: str
    words: tuple[str, ...]
    outputs: tuple[str, ...]


RAW = ("office.log.gz", "--map", "office.dat.gz")
QUIET = (*FEW, "--no-record")
RUN = ("new/run.rrd", "new/trajectory.tum", "new/run.json")
COMMANDS = (
    Broken("convert", ("convert", *RAW, "-o", "new.mcap"), ("new.mcap",)),
    Broken("convert map", ("convert", "office.dat.gz", "-o", "new.yaml"), ("new.yaml", "new.pgm")),
    Broken("localize", ("localize", "office.mcap", *FEW, "-o", "new"), RUN),
    Broken("localize raw", ("localize", *RAW, *QUIET, "-o", "new"), RUN),
    Broken(
        "localize for ROS", ("localize", *RAW, *QUIET, "--output-mcap", "new.mcap", "-o", "new"), ("new.mcap", *RUN)
    ),
    Broken("tune", ("tune", "office.mcap", "-o", "new.yaml"), ("new.yaml",)),
    Broken("share", ("share", "run", "-o", "new.html"), ("new.html",)),
    Broken("share many", ("share", "run", "--folder", "new"), ("new/index.html",)),
    Broken("export", ("export", "run", "-o", "new.png"), ("new.png",)),
    Broken("export movie", ("export", "run", "-o", "new.gif"), ("new.gif",)),
    Broken("export raw", ("export", "office.mcap", "--raw", "new"), ("new/office.log",)),
    Broken("check", ("check", "office.mcap", "--particles", "2000", "-o", "new.html"), ("new.html",)),
)
BAD_WORDS = ("Traceback", "Fatal Python", "panicked", "core dumped", " ERROR ", " WARN ")


@dataclass(frozen=True)
class Ended:
    """How a command ended: exit code, stderr, seconds."""

    code: int
    said: str
    seconds: float


class Desk:
    """A folder with a log, a map and a run, and a cache of its own, in which commands break down."""

    def __init__(self, home: Path) -> None:
        self.home, self.cache, self.temporary = home / "desk", home / "cache", home / "tmp"
        for folder in (self.home, self.cache, self.temporary):
            folder.mkdir()
        for name in ("office.log.gz", "office.dat.gz"):
            shutil.copy(SAMPLE / name, self.home / name)
        self.sound(("convert", "office.log.gz", "--map", "office.dat.gz", "-o", "office.mcap"))
        self.sound(("localize", "office.mcap", *FEW, "-o", "run"))
        self.sound(("localize", "office.log.gz", "--map", "office.dat.gz", *FEW, "--no-record", "-o", "raw"))
        self.sound(("check", "office.mcap", "--particles", "2000"))
        shutil.rmtree(self.home / "raw")
        self.before = self.listing()

    def listing(self) -> dict[str, tuple[int, int]]:
        """Every file of the desk: its size and when it was written."""
        found = (path for path in self.home.rglob("*") if path.is_file())
        return {str(p.relative_to(self.home)): (p.stat().st_size, p.stat().st_mtime_ns) for p in found}

    def begin(self, words: Sequence[str], limit: int | None = None) -> subprocess.Popen[str]:
        """Start a command; ``limit``: bytes that a file may have."""
        environment = os.environ | {
            "MCL_CACHE_DIR": str(self.cache), "TMPDIR": str(self.temporary), "NO_COLOR": "1", "PYTHONPATH": str(ROOT),
        }  # fmt: skip

        def full_disk() -> None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit or resource.RLIM_INFINITY, resource.RLIM_INFINITY))

        return subprocess.Popen(
            [sys.executable, "-m", "pipeline.cli", *words], cwd=self.home, env=environment, text=True,
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True, preexec_fn=full_disk,
        )  # fmt: skip

    def end(self, process: subprocess.Popen[str], begun: float) -> Ended:
        """Wait for it, at most two minutes."""
        try:
            said = process.communicate(timeout=120)[1]
        except subprocess.TimeoutExpired:
            process.kill()
            return Ended(-999, "it hangs", time.monotonic() - begun)
        return Ended(process.returncode, said, time.monotonic() - begun)

    def sound(self, words: Sequence[str]) -> Ended:
        """Run a command that must succeed."""
        begun = time.monotonic()
        ended = self.end(self.begin(words), begun)
        if ended.code:
            raise AssertionError(f"mcl {' '.join(words)}: {ended.code}\n{ended.said}")
        return ended

    def clear(self) -> None:
        """Away with whatever is new."""
        for path in list(self.home.iterdir()):
            if path.name.startswith(("new", ".new")):
                shutil.rmtree(path) if path.is_dir() else path.unlink()
        for path in self.temporary.iterdir():
            shutil.rmtree(path) if path.is_dir() else path.unlink()

    def wrong(self, command: Broken, ended: Ended, killed: bool = False) -> Iterator[str]:
        """What is not as it must be after a command broke down."""
        now = self.listing()
        for name, was in self.before.items():
            if now.get(name) != was:
                yield f"{name} is not what it was"
        lines = [line for line in ended.said.splitlines() if line.startswith(("error:", "stopped"))]
        if any(word in ended.said for word in BAD_WORDS):
            yield f"it says: {ended.said[-1500:]}"
        if ended.code == -999:
            yield "it hangs"
        if len(lines) > 1 and not any(line.startswith("stopped") for line in lines):
            yield f"{len(lines)} lines of error: {lines}"
        if ended.code > 0 and not lines and ended.code != 143:
            yield f"it ends with {ended.code} and no line of error: {ended.said!r}"
        yield from self._half(command)
        if killed:
            return
        left = [n for n in now if n not in self.before and (Path(n).name.startswith(".") or ".part" in n)]
        left += [path.name for path in self.temporary.iterdir()]
        if left:
            yield f"left behind: {left}"

    def _half(self, command: Broken) -> Iterator[str]:
        """Files under final names that are not whole."""
        for name in command.outputs:
            path = self.home / name
            if not path.exists():
                continue
            data, suffix = path.read_bytes(), path.suffix
            whole = {
                ".mcap": data[-8:] == b"\x89MCAP0\r\n",
                ".html": data.rstrip().endswith(b"</html>"),
                ".json": data.rstrip().endswith(b"}"),
                ".gif": data.endswith(b"\x3b"),
                ".png": data[-8:-4] == b"IEND",
                ".pgm": len(data) > 70_000,
                ".yaml": data.endswith(b"\n"),
                ".tum": data.endswith(b"\n"),
            }.get(suffix, True)
            if not whole:
                yield f"{name} is half a file, of {len(data)} bytes"

    def children(self) -> list[int]:
        """Processes that still work at this desk."""
        found = []
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit() and int(entry.name) != os.getpid():
                try:
                    if (entry / "cwd").resolve() == self.home:
                        found.append(int(entry.name))
                except OSError:
                    continue
        return found


def stopped(desk: Desk, command: Broken, sent: signal.Signals, after: float) -> list[str]:
    """Stop a command so many seconds after its start: what is wrong then, and whether the next one succeeds."""
    begun = time.monotonic()
    process = desk.begin(command.words)
    try:
        process.wait(timeout=after)
    except subprocess.TimeoutExpired:
        os.kill(process.pid, sent)
    ended = desk.end(process, begun)
    wrong = list(desk.wrong(command, ended, killed=sent is signal.SIGKILL))
    if left := desk.children():
        time.sleep(0.5)
        if left := desk.children():
            wrong.append(f"processes are left: {left}")
    return wrong + again(desk, command)


def again(desk: Desk, command: Broken) -> list[str]:
    """The same command once more, undisturbed, after everything new is away."""
    desk.clear()
    try:
        desk.sound(command.words)
    except AssertionError as error:
        return [f"the next run fails: {error}"]
    finally:
        desk.clear()
    return []


def on_a_full_disk(desk: Desk, command: Broken, limit: int) -> list[str]:
    """No file can grow beyond the limit."""
    begun = time.monotonic()
    ended = desk.end(desk.begin(command.words, limit), begun)
    wrong = list(desk.wrong(command, ended))
    desk.clear()
    return wrong


def read_only(desk: Desk, command: Broken) -> list[str]:
    """Nothing can be written into the folder; who may do everything finds another way to say so."""
    desk.home.chmod(0o500)
    try:
        if os.access(desk.home, os.W_OK):
            return []
        begun = time.monotonic()
        ended = desk.end(desk.begin(command.words), begun)
        return list(desk.wrong(command, ended)) + ([] if ended.code == 1 else [f"it ends with {ended.code}"])
    finally:
        desk.home.chmod(0o700)
        desk.clear()


def two_at_once(desk: Desk, command: Broken) -> list[str]:
    """Two of one command with one output: one of them wins, or both in turn, and what is there is whole."""
    begun = time.monotonic()
    both = [desk.begin(command.words) for _ in range(2)]
    ended = [desk.end(process, begun) for process in both]
    wrong = [said for one in ended for said in desk.wrong(command, one)]
    if all(one.code for one in ended):
        wrong.append(f"neither succeeds: {[one.said[-300:] for one in ended]}")
    desk.clear()
    return wrong


def cut_cache(desk: Desk, rng: random.Random) -> list[str]:
    """Every file of the cache cut somewhere: it is made again, or left aside."""
    for path in desk.cache.rglob("*"):
        if path.is_file():
            with path.open("rb+") as file:
                file.truncate(rng.randrange(path.stat().st_size + 1))
    wrong = []
    for command in COMMANDS:
        if command.name in ("localize", "localize raw"):
            wrong += again(desk, command)
    return wrong


def rounds(
    desk: Desk, number: int, seed: int, commands: Sequence[Broken] = COMMANDS
) -> Iterator[tuple[str, list[str]]]:
    """Break every command down so many times: what was done, and what was wrong then."""
    rng = random.Random(seed)
    usual = {}
    for command in commands:
        usual[command.name] = desk.sound(command.words).seconds
        desk.clear()
    for k in range(number):
        for command in commands:
            for sent in SIGNALS:
                after = rng.uniform(0.02, 1.05) * usual[command.name]
                yield f"{k} {command.name}: {sent.name} after {after:.2f} s", stopped(desk, command, sent, after)
            limit = round(10 ** rng.uniform(2.0, 6.0))
            yield f"{k} {command.name}: files of at most {limit} bytes", on_a_full_disk(desk, command, limit)
        if k == 0:
            for command in commands:
                yield f"{command.name}: read-only folder", read_only(desk, command)
                yield f"{command.name}: two at once", two_at_once(desk, command)
        yield f"{k} a cache that is cut", cut_cache(desk, rng)


def main() -> None:
    """As the command line says."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", action="append", choices=[command.name for command in COMMANDS])
    asked = parser.parse_args()
    commands = [command for command in COMMANDS if not asked.only or command.name in asked.only]
    faults = done = 0
    with tempfile.TemporaryDirectory(prefix="mcl-breakdowns-") as home:
        for what, wrong in rounds(Desk(Path(home)), asked.rounds, asked.seed, commands):
            done += 1
            faults += bool(wrong)
            for said in wrong:
                print(f"{what}: {said}", flush=True)
    print(f"{done:,} breakdowns, {faults} faults")
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
