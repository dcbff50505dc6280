"""Pages hold their run, refer to nothing outside of themselves, and open in a browser where there is one."""

import base64
import gzip
import html.parser
import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.errors import MclError
from pipeline.export.run import read_run
from pipeline.inspect import RecordedEvent
from pipeline.share import pages, player
from pipeline.share.pages import Viewer

BROWSER = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
)
needs_browser = pytest.mark.skipif(BROWSER is None, reason="no browser: apt-get install chromium")


@pytest.fixture(scope="module")
def run(recorded: Path):
    return read_run(recorded)


@pytest.fixture
def typed():
    return lambda *args: CliRunner().invoke(app, [str(arg) for arg in args])


def opened(path: Path, fragment: str, profile: Path, *words: str) -> str:
    """The page as the browser has it after a while, without a network of any kind."""
    command = [
        BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--no-first-run",
        "--proxy-server=127.0.0.1:9", f"--user-data-dir={profile}", "--virtual-time-budget=5000", "--dump-dom",
        *words, f"{path.as_uri()}{fragment}",
    ]  # fmt: skip
    return subprocess.run(command, capture_output=True, text=True, timeout=120).stdout


class References(html.parser.HTMLParser):
    """Whatever a page would fetch."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        wanted = ("src", "href", "srcset", "data", "action", "poster")
        self.found += [value for name, value in attrs if name in wanted and value and not value.startswith("data:")]


def test_a_page_holds_the_run(run):
    head, data = player.packed(run)
    raw = gzip.decompress(data)
    found = {name: np.frombuffer(raw, kind, length, at) for name, kind, at, length in head["arrays"]}
    scenes = run.scenes
    assert found["times"].tolist() == scenes.times.tolist()
    assert np.allclose(found["estimates"].reshape(-1, 3), scenes.estimates, atol=1e-5)
    for name in ("hits", "shorts", "longs", "expected", "particles"):
        places = found[name].reshape(-1, 2) * head["step"] + head["low"]
        assert np.allclose(places, getattr(scenes, name).values[:, :2], atol=head["step"]), name
        assert (np.diff(found[f"{name}_at"]) == getattr(scenes, name).lengths).all()
    turned = found["heading"] * (np.pi / 128) - scenes.particles.values[:, 2]
    assert np.abs(np.angle(np.exp(1j * turned))).max() < 0.02
    assert (found["level"] == scenes.levels.values).all()
    assert (found["shades"].reshape(scenes.shades.shape) == scenes.shades).all()
    assert [event["text"] for event in head["events"]] == [event.text for event in run.told.events]
    assert head["labels"][20] == ["60 %", "40 %"]


def test_many_particles_are_thinned_evenly(run, monkeypatch):
    monkeypatch.setattr(player, "PER_SCAN", 7)
    kept = player._thinned(run.scenes.particles)
    assert kept.lengths.tolist() == [7] * 150
    assert len(set(kept.values.tolist())) == 7 * 150
    assert (np.repeat(np.arange(150), 7) == kept.values // 30).all()


def test_a_page_refers_to_nothing_outside(recorded, tmp_path):
    pages.share(recorded, tmp_path / "run.html")
    page = (tmp_path / "run.html").read_text()
    assert References(page).found == []
    assert "default-src 'none'" in page
    assert not re.findall(r"@[A-Z]+@", page)


def test_a_name_cannot_break_out_of_the_page(run, monkeypatch):
    evil = '</script><script>alert("@DATA@")</script><!--'
    monkeypatch.setattr(type(run), "name", property(lambda _: evil))
    page = player.page(run)
    assert page.count("<script>") == player_scripts()
    head = re.search(r'id="head">(.*?)</script>', page, re.S)[1]
    assert json.loads(head)["log"] == evil
    data = re.search(r'id="data">(.*?)</script>', page, re.S)[1]
    assert gzip.decompress(base64.b64decode(data))


def player_scripts() -> int:
    template = Path(player.__file__).with_name("player.html").read_text()
    return template.count("<script>")


def test_rerun_s_viewer_and_the_recording_are_inside(recorded, tmp_path):
    viewer = Viewer("let wasm_bindgen; // @RECORDING@", base64.b64encode(gzip.compress(b"\0asm")).decode())
    pages.share(recorded, tmp_path / "run.html", viewer=viewer)
    page = (tmp_path / "run.html").read_text()
    packed = re.search(r'id="recording">(.*?)</script>', page, re.S)[1]
    assert gzip.decompress(base64.b64decode(packed)) == (recorded / "run.rrd").read_bytes()
    assert References(page).found == []
    assert "let wasm_bindgen; // @RECORDING@" in page


def test_the_viewer_s_files_are_in_its_program():
    from pipeline.recording.viewer import web_files

    javascript, wasm = web_files()
    # What the page calls: rerun may rename it from one version to the next.
    for name in ("WebHandle", "open_channel", "send_rrd_to_channel", "close_channel", "wasm_bindgen"):
        assert name in javascript
    assert wasm[:4] == b"\0asm"


def test_a_folder_has_an_index(typed, recorded, tmp_path):
    done = typed("share", recorded, recorded / "run.rrd", "--folder", tmp_path / "site")
    assert done.exit_code == 0
    assert done.stdout.strip() == str(tmp_path / "site" / "index.html")
    index = (tmp_path / "site" / "index.html").read_text()
    names = References(index).found
    assert names == ["synthetic-seed7.html", "synthetic-seed7-2.html"]
    assert all((tmp_path / "site" / name).exists() for name in names)
    assert "9.2 s" in index
    again = typed("share", recorded, "--folder", tmp_path / "site")
    assert (again.exit_code, "exists already" in again.stderr) == (1, True)
    assert typed("share", recorded, "--folder", tmp_path / "site", "--force").exit_code == 0


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ((), 2, "--folder"),
        (("-o", "a.html", "--folder", "site"), 2, "--folder"),
        (("-o", "a.png"), 1, "ends in .html"),
        (("-o", "nosuch/a.html"), 1, "folder to write to"),
    ],
)
def test_what_cannot_be(typed, recorded, tmp_path, monkeypatch, words, code, said):
    monkeypatch.chdir(tmp_path)
    done = typed("share", recorded, *words)
    assert done.exit_code == code
    assert said in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_replaced_unasked(recorded, tmp_path):
    (tmp_path / "run.html").write_text("precious")
    with pytest.raises(MclError, match="exists already"):
        pages.share(recorded, tmp_path / "run.html")
    assert (tmp_path / "run.html").read_text() == "precious"


@needs_browser
def test_it_opens_from_a_file_without_a_network(recorded, tmp_path):
    page = tmp_path / "run.html"
    pages.share(recorded, page)
    shown = opened(page, "#t=20", tmp_path / "profile")
    assert 'data-ready="150"' in shown
    assert re.search(r'id="clock"[^>]*>20\.0 s<', shown)
    assert re.search(r'id="said"[^>]*>One hypothesis is left<', shown)
    assert re.search(r'<button class="[^"]*now[^"]*">One hypothesis is left<', shown)


@needs_browser
def test_the_latest_event_is_seen_and_the_colours_are_explained_without_scrolling(run, tmp_path):
    many = tuple(RecordedEvent(k, 0.2 * k, "searched", "INFO", f"Searched, number {k}") for k in range(0, 150, 5))
    page = player.page(replace(run, told=replace(run.told, events=many)))
    # No timer: the browser's clock would run ahead of the page, which unpacks its data meanwhile.
    look = """<script>new MutationObserver(() => {
      if (!document.querySelector("[data-ready]") || !document.querySelector("ol .now")) return;
      const inside = (a, b) => a.top >= b.top - 1 && a.bottom <= b.bottom + 1;
      const box = query => document.querySelector(query).getBoundingClientRect();
      document.body.dataset.seen = [inside(box("ol .now"), box("ol")), inside(box("#layers"), box("aside")), scrollY];
    }).observe(document, {subtree: true, attributes: true, attributeFilter: ["data-ready", "class"]})</script></body>"""
    (tmp_path / "run.html").write_text(page.replace("</body>", look))
    shown = opened(tmp_path / "run.html", "#t=25", tmp_path / "profile", "--window-size=1400,900")
    assert 'data-seen="true,true,0"' in shown
