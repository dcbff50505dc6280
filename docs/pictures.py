"""Makes the pictures of the documentation: the embedded building in rerun's viewer, headless, and in a browser.

`make pictures` runs it. It needs a Vulkan driver; one in software will do (Debian: libvulkan1 mesa-vulkan-drivers).
"""

from __future__ import annotations

import dataclasses
import os
import shutil
import socket
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image
from rerun.experimental import ViewerClient

from converters import convert
from pipeline.config import load_config
from pipeline.export.files import Wishes, export
from pipeline.export.run import read_run
from pipeline.geometry import between, compose
from pipeline.inspect import inspect
from pipeline.lessons import lesson
from pipeline.lessons.showing import record_step
from pipeline.logs.messages import Log
from pipeline.logs.reader import read_log
from pipeline.recording import entities
from pipeline.recording.run_folder import create
from pipeline.recording.side_by_side import Shown, write_run
from pipeline.recording.viewer import program, quiet
from pipeline.replay import replay
from pipeline.share.pages import share
from pipeline.simulate import sample_dir

PICTURES = Path(__file__).with_name("pictures")
CARRIED_OFF = (40.0, 60.0)
BACKWARDS = (50.0, 56.0)
WITNESSES_TAB = 2
PART, PART_AT, OFF_THE_MAP = 8.0, 45.0, 47.0
"""m, s, s: side of the square that a map lacks, when the robot is in its middle, and when it is looked at."""
SIZE = (1440, 782)
TITLE_BAR = 38  # rows of the viewer's own window that say nothing about a run
PATIENCE = 60.0
HUES = 192  # of the 256 colours of a picture; the others are greys


def main() -> None:
    """Localize the sample, and the sample with half a minute missing; take a picture of what is worth one."""
    sample = sample_dir()
    with tempfile.TemporaryDirectory() as folder:
        runs = {}
        for name, drop in (("office", []), ("carried_off", [CARRIED_OFF])):
            path = Path(folder) / f"{name}.mcap"
            truth, grid = sample / "office_truth.tum", sample / "office.dat.gz"
            convert([sample / "office.log.gz"], path, map_path=grid, ground_truth=truth, drop=drop)
            made = create(name, Path(folder) / name)
            replay(read_log(path), load_config(), made)
            runs[name] = inspect(made.path)
        whole, kidnapped = runs["office"], runs["carried_off"]
        found = next((e.time for e in kidnapped.events if e.kind == "found" and e.time > CARRIED_OFF[1]), None)
        moments = [
            ("office", whole, 1.6),
            ("converged", whole, (whole.converged_at or 5.0) + 1.0),
            ("end", whole, whole.duration),
            ("carried_off", kidnapped, CARRIED_OFF[1] + 0.3),
            *([("found_again", kidnapped, found + 1.0)] if found else []),
        ]
        for name, run, at in moments:
            take(run.path, at, PICTURES / f"{name}.png")
            browse(run.path, at, PICTURES / f"page_{name}.png")
            print(f"{name}: {run.pose_at(at).time:.1f} s")
        export(read_run(whole.path), PICTURES / "found.webp", Wishes(speed=16.0, size=(800, 450)), force=True)
        part = without_a_part(read_log(Path(folder) / "office.mcap"))
        made = create("off_map", Path(folder) / "off_map")
        replay(part, load_config(), made)
        take(made.recording, OFF_THE_MAP, PICTURES / "off_map.png")
        wrong = wheels_backwards(read_log(Path(folder) / "office.mcap"))
        made = create("witnesses", Path(folder) / "witnesses")
        replay(wrong, load_config(), made)
        run, front = read_run(made.path), Path(folder) / "witnesses.rrd"
        write_run(front, Shown(run.name, run.file, run.scenes), tab=WITNESSES_TAB)
        take(front, BACKWARDS[1] - 1.0, PICTURES / "witnesses.png")
        drawn, step = lesson("4.4"), Path(folder) / "step.rrd"
        record_step(drawn, drawn.reference, step, PATIENCE)
        take(step, 0, PICTURES / "substeps.png", timeline=entities.SUBSTEP, settle=12.0)


def without_a_part(log: Log) -> Log:
    """The same drive, but the map knows nothing of a square in which the robot is for half a minute."""
    grid, truth = log.grid, log.ground_truth
    assert grid is not None
    assert truth is not None
    x, y, _ = grid.to_grid(truth.poses[np.searchsorted(truth.stamps, log.stamps[0] + int(PART_AT * 1e9))])
    occupancy, reach = grid.occupancy.copy(), PART / 2
    rows, columns = (
        slice(max(0, int((v - reach) / grid.resolution)), int((v + reach) / grid.resolution)) for v in (y, x)
    )
    occupancy[rows, columns] = np.nan
    return dataclasses.replace(log, grid=dataclasses.replace(grid, occupancy=occupancy), name="office_incomplete")


def wheels_backwards(log: Log) -> Log:
    """The same drive, but for some seconds the wheels count forwards as backwards."""
    steps = between(log.odometry[:-1], log.odometry[1:])
    wrong = (log.times[1:] > BACKWARDS[0]) & (log.times[1:] <= BACKWARDS[1])
    steps[wrong, :2] *= -1.0
    poses = [log.odometry[0]]
    for step in steps:
        poses.append(compose(poses[-1], step))
    return dataclasses.replace(log, odometry=np.array(poses), name="office_backwards")


def take(recording: Path, at: float, picture: Path, timeline: str = entities.TIME, settle: float = 3.0) -> None:
    """What the viewer shows so many seconds after the first scan, or at that number on another timeline.

    ``settle``: seconds until everything is drawn, and until what the viewer says of itself is gone.
    """
    os.environ |= quiet()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    with ViewerClient.spawn(
        headless=True, port=port, hide_welcome_screen=True, executable_path=str(program())
    ) as viewer:
        viewer.open(str(recording))
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            state = viewer.get_state()
            if not state.loading and state.recordings and state.recordings[0].timelines and state.views:
                break
            time.sleep(0.2)
        moment = {"duration": at} if timeline == entities.TIME else {"sequence": int(at)}
        viewer.set_time(timeline, **moment, play_state="paused")
        time.sleep(settle)  # the viewer says when it has loaded, not when it has drawn
        raw = picture.with_suffix(".raw.png")
        viewer.save_screenshot(str(raw.resolve()))
    try:
        shown = Image.open(raw).convert("RGB")
        shown = shown.crop((0, TITLE_BAR, *shown.size)).resize(SIZE, Image.Resampling.LANCZOS)
        shown.quantize(palette=colours(shown), dither=Image.Dither.NONE).save(picture, optimize=True)
    finally:
        raw.unlink()


def browse(recording: Path, at: float, picture: Path) -> None:
    """What a browser shows of the page that `mcl share` makes, so many seconds after the first scan."""
    browser = next((found for name in ("chromium", "google-chrome") if (found := shutil.which(name))), None)
    if browser is None:
        print(f"{picture.name} is left as it was: there is no Chromium (Debian: chromium)")
        return
    with tempfile.TemporaryDirectory() as folder:
        page, shot = Path(folder) / "run.html", Path(folder) / "shot.png"
        share(recording, page)
        size = f"--window-size={SIZE[0]},{SIZE[1]}"
        quietly = ("--headless", "--no-sandbox", "--no-first-run", f"--user-data-dir={folder}/profile")
        wait = "--virtual-time-budget=8000"
        command = [browser, *quietly, size, wait, f"--screenshot={shot}", f"{page.as_uri()}#t={at}"]
        subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE)
        shown = Image.open(shot).convert("RGB")
        shown.quantize(palette=colours(shown), dither=Image.Dither.NONE).save(picture, optimize=True)


def colours(picture: Image.Image) -> Image.Image:
    """A palette of the picture that has its hues, however few of its pixels have any: what is thin is what matters."""
    pixels = np.asarray(picture).reshape(-1, 3)
    bright = pixels[np.ptp(pixels, axis=1) > 40]
    hues = Image.fromarray(bright[None]).quantize(HUES, dither=Image.Dither.NONE).getpalette() or []
    greys = [level for level in np.linspace(0, 255, 256 - HUES).astype(int).tolist() for _ in range(3)]
    palette = Image.new("P", (1, 1))
    palette.putpalette([*hues[: 3 * HUES], *greys])
    return palette


if __name__ == "__main__":
    main()
