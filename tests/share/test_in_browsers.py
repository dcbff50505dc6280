"""The pages in real browsers, as a person uses them: keys, clicks, links, touch, print, screen readers, contrast."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.compare import Track
from pipeline.export.run import read_run
from pipeline.inspect import RecordedEvent
from pipeline.logs.messages import Trajectory
from pipeline.recording import palette
from pipeline.share import pages, player

DRIVER = Path(__file__).parents[2] / ".browsers"
BROWSERS = {"chrome": ("chromium", "chromium-browser", "google-chrome"), "firefox": ("firefox-esr", "firefox")}


def missing(name: str) -> str:
    """What a browser's tests lack, and how to get it; empty if nothing."""
    if not any(map(shutil.which, BROWSERS[name])):
        return f"no {name}: apt-get install {BROWSERS[name][0]}"
    if not shutil.which("node"):
        return "no node: apt-get install nodejs npm"
    return "" if (DRIVER / "node_modules" / "puppeteer-core").exists() else "no driver: make .browsers/.installed"


@pytest.fixture(scope="module", params=BROWSERS)
def browser(request) -> str:
    if lacking := missing(request.param):
        pytest.skip(lacking)
    return request.param


@pytest.fixture(scope="module")
def files(recorded, another, tmp_path_factory) -> dict[str, Path]:
    """The pages that are opened: a run, one with many events, several, and an index."""
    folder = tmp_path_factory.mktemp("pages")
    pages.share(recorded, folder / "run.html")
    run, other = read_run(recorded), read_run(another)
    many = tuple(RecordedEvent(k, 0.2 * k, "searched", "INFO", f"Searched, number {k}") for k in range(0, 150, 5))
    (folder / "many.html").write_text(player.page([replace(run, told=replace(run.told, events=many))]))
    poses = run.told.poses[20:].copy()
    poses[40:60, 0] += 3.0
    track = Track("amcl.tum", Trajectory(run.told.stamps[20:], poses))
    pages.share_comparison([run, other, track], folder / "several.html")
    index = pages.share_folder([recorded, another], folder / "site")[-1]
    return {"run": folder / "run.html", "many": folder / "many.html", "several": folder / "several.html",
            "index": index, "out": folder}  # fmt: skip


@pytest.fixture(scope="module")
def seen(browser, files, tmp_path_factory):
    """What the browser showed."""
    executable = next(filter(None, map(shutil.which, BROWSERS[browser])))
    script, profile = Path(__file__).with_name("browse.mjs"), tmp_path_factory.mktemp("profile")
    named = json.dumps({name: str(path) for name, path in files.items()})
    command = ["node", script, DRIVER, browser, executable, profile, named]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_nothing_is_asked_of_anybody_and_nothing_goes_wrong(seen, browser, files):
    assert seen["complaints"] == []
    own = {files[name].as_uri() for name in ("run", "many", "several", "index")}
    asked = {url.partition("#")[0] for url in seen["requests"] if not url.startswith(("data:", "blob:"))}
    assert asked == own if browser == "chrome" else asked <= own  # Firefox tells of the network only


def test_a_link_opens_at_its_instant(seen):
    assert seen["loaded"]["clock"] == "20.0 s"
    assert seen["loaded"]["event"] == "One hypothesis is left"
    assert seen["loaded"]["said"].startswith("FOUND: it knows where it is")
    assert seen["linked"]["clock"] == "5.1 s"
    assert re.match(r"LOST: .*Places in question, .*: A 60 %, B 40 %\.", seen["linked"]["said"])
    assert seen["link"] == "#t=5.10"
    assert all(count > 3 for count in seen["colours"])


def test_keys_and_clicks_move_the_clock(seen):
    assert [clock for _, clock in seen["keys"]] == [
        "20.2 s", "20.0 s", "21.0 s", "20.0 s", "21.0 s", "9.2 s", "29.8 s", "0.0 s", "10.0 s",
    ]  # fmt: skip
    assert (seen["playing"], seen["paused"]) == ("Pause", "Play")
    assert seen["clicked"]["clock"] == "21.0 s"
    assert seen["clicked"]["event"] == "The map explains 40 % of the beams"
    assert seen["half"]["clock"] == "14.9 s"
    assert seen["hidden"]


def test_a_phone_shows_all_of_it_and_a_finger_moves_the_clock(seen):
    shown, there = seen["phone"]["width"]
    assert shown <= there == 360
    assert all(count > 3 for count in seen["phone"]["colours"])
    first, second = (float(seen["phone"][which].removesuffix(" s")) for which in ("touched", "moved"))
    assert first == pytest.approx(7.5, abs=0.3)
    assert second == pytest.approx(22.4, abs=0.3)


def test_the_latest_event_is_seen_and_the_colours_are_explained_without_scrolling(seen):
    assert seen["many"] == {"event": True, "legend": True, "scrolled": 0}


def test_texts_have_the_contrast_that_wcag_aa_asks_for(seen, browser):
    by_day = [seen["contrast"], seen["several_contrast"], seen["index"]["contrast"]]
    by_night = [seen[f"{name}_by_night"] for name in ("run", "several", "index")] if browser == "chrome" else []
    for found in (*by_day, *by_night):
        assert found["texts"] > 10
        assert found["low"] == []


def test_a_screen_reader_is_told_what_is_where(seen, browser):
    if browser != "chrome":
        pytest.skip("only Chromium gives out its accessibility tree")

    def names(node):
        yield node["role"], node.get("name", ""), str(node.get("valuetext", ""))
        for child in node.get("children", ()):
            yield from names(child)

    told = list(names(seen["tree"]))
    roles = {role for role, _, _ in told}
    assert {"main", "complementary", "slider", "button", "checkbox", "image", "heading"} <= roles
    unnamed = [
        role for role, name, _ in told if role in ("slider", "button", "checkbox", "image", "combobox") and not name
    ]
    assert unnamed == []
    assert any(role == "image" and name.startswith("Map: FOUND: it knows where it is") for role, name, _ in told)
    assert any(role == "image" and "error of the estimate, m: 0.0" in name for role, name, _ in told)
    assert any(role == "slider" and name == "Time in seconds" for role, name, _ in told)


def test_it_can_be_printed(seen, browser, files):
    printed = files["out"] / f"{browser}.pdf"
    assert printed.read_bytes()[:5] == b"%PDF-"
    if not shutil.which("pdftotext"):
        pytest.skip("the rest needs pdftotext: apt-get install poppler-utils")
    text = subprocess.run(["pdftotext", "-layout", printed, "-"], capture_output=True, text=True).stdout
    assert "FOUND: it knows where it is" in " ".join(text.split())
    assert "One hypothesis is left" in text
    assert "particles; the darker, the heavier" in text
    assert "Play" not in text
    assert text.count("\f") <= 3
    subprocess.run(["pdftoppm", "-r", "50", "-f", "1", "-l", "1", "-png", printed, printed.with_suffix("")], check=True)
    (first,) = files["out"].glob(f"{browser}-*.png")
    pixels = np.asarray(Image.open(first).convert("RGB")).reshape(-1, 3).astype(int)
    for colour in (palette.ESTIMATE, palette.HIT, palette.VERDICTS["found"]):  # the path, beams, the state line
        assert (np.abs(pixels - colour).max(axis=1) < 40).sum() > 10


def test_several_runs_are_beside_each_other_on_one_clock(seen):
    (together,) = seen["together"]
    assert re.search(
        r"A synthetic, seed 7 found at .*B synthetic, seed 8 found at .* m from A.*C amcl.tum at", together
    )
    assert len(seen["parting"]) == 1
    assert seen["parting"][0].startswith("C Parts from A at 12.0 s: 3.0")
    assert len(seen["beside"]["captions"]) == 2
    assert seen["beside"]["pressed"] == ["false", "true"]
    assert all(count > 3 for count in seen["beside"]["colours"])
    assert seen["several_width"][0] <= seen["several_width"][1] == 360


def test_the_index_sorts_and_flags(seen):
    index = seen["index"]
    assert sorted(index["before"]) == [["synthetic, seed 7", "sound"], ["synthetic, seed 8", "flagged"]]
    assert index["first"][0][0] == ["synthetic, seed 8", "flagged"]
    assert index["again"][0][0] == ["synthetic, seed 7", "sound"]
    assert [which[1][1] for which in (index["first"], index["again"])] == ["ascending", "descending"]
    assert index["pictures"] == [320, 320]
    assert index["width"][0] <= index["width"][1] == 360
