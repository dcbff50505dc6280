"""Pages hold their runs, and refer to nothing outside of themselves."""

import base64
import gzip
import hashlib
import html.parser
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.compare import Track, errors
from pipeline.errors import MclError
from pipeline.export.run import read_run
from pipeline.logs.messages import Trajectory
from pipeline.recording.scenes import Ragged
from pipeline.share import packing, pages, player
from pipeline.share.index import index
from pipeline.share.pages import Viewer


@pytest.fixture(scope="module")
def run(recorded: Path):
    return read_run(recorded)


@pytest.fixture
def typed():
    return lambda *args: CliRunner().invoke(app, [str(arg) for arg in args])


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
    head, (found,) = unpacked([run])
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
    texts = json.loads(bytes(found["texts"]))
    assert texts["labels"][20] == ["A 60 %", "B 40 %"]
    assert [texts["said"][k] for k in found["said_at"]] == [packing.plain(text) for text in run.scenes.captions]
    assert np.nanmax(found["error"]) == pytest.approx(np.nanmax(errors(run)[0]), abs=1e-4)


def unpacked(compared):
    """The head of a page, and the arrays of everyone in it, by name."""
    head, data = player.packed(compared)
    raw = gzip.decompress(data)
    parts = [one["arrays"] for one in head["runs"]]
    return head, [{name: np.frombuffer(raw, kind, length, at) for name, kind, at, length in part} for part in parts]


def test_several_runs_have_one_clock(run):
    later = replace(run, told=replace(run.told, stamps=run.told.stamps + 2_000_000_000))
    elsewhen = replace(run, told=replace(run.told, stamps=run.told.stamps + 10**15))
    track = Track("amcl.tum", Trajectory(run.told.stamps[50:], run.told.poses[50:]))
    head, found = unpacked([run, later, elsewhen, track])
    shifts = [float(one["times"][0]) - float(run.scenes.times[0]) for one in found]
    assert shifts == pytest.approx([0, 2, 0, run.told.times[50] - run.told.times[0]], abs=1e-6)
    assert [one["letter"] for one in head["runs"]] == ["A", "B", "C", "D"]
    assert len({tuple(one["colour"]) for one in head["runs"]}) == 4
    assert np.allclose(found[3]["apart"], 0, atol=1e-6)
    assert found[3]["error"] == pytest.approx(found[0]["error"][50:], abs=1e-6)


def test_a_cell_that_changed_is_kept_once_for_each_span_in_which_it_is_so(run):
    first, second = (0.0, 5.0, 1.0), (1.0, 6.0, 2.0)
    cells = [[first], [first, second], [first], [second]]
    flat = np.array([cell for row in cells for cell in row])
    changed = Ragged(flat, np.concatenate([[0], np.cumsum([len(row) for row in cells])]))
    scenes = replace(run.scenes, changed=changed, changed_at=np.array([10, 20, 30, 40]))
    _, (found,) = unpacked([replace(run, scenes=scenes)])
    spans = zip(*(found[f"changed{which}"].tolist() for which in ("_kind", "_from", "_until")), strict=True)
    assert sorted(spans) == [(1, 10, 40), (2, 20, 30), (2, 40, 150)]


def test_many_particles_are_thinned_evenly(run, monkeypatch):
    monkeypatch.setattr(packing, "PER_SCAN", 14)
    kept = packing._thinned(run.scenes.particles, 0.5)
    assert kept.lengths.tolist() == [7] * 150
    assert len(set(kept.values.tolist())) == 7 * 150
    assert (np.repeat(np.arange(150), 7) == kept.values // 30).all()


def test_a_page_refers_to_nothing_outside(recorded, tmp_path):
    pages.share(recorded, tmp_path / "run.html")
    page = (tmp_path / "run.html").read_text()
    assert References(page).found == []
    assert not re.findall(r"@[A-Z]+@", page)
    rules = re.search(r'Content-Security-Policy" content="(.*?)"', page)[1]
    assert "default-src 'none'" in rules
    assert "unsafe" not in rules
    for element in ("style", "script"):  # what may run is what stands there, and nothing else
        own = re.search(rf"<{element}>(.*?)</{element}>", page, re.S)[1]
        assert f"{element}-src 'sha256-{base64.b64encode(hashlib.sha256(own.encode()).digest()).decode()}'" in rules


def test_a_name_cannot_break_out_of_the_page(run, monkeypatch):
    evil = '</script><script>alert("@DATA@")</script><!--'
    monkeypatch.setattr(type(run), "name", property(lambda _: evil))
    page = player.page([run])
    assert page.count("<script>") == player_scripts()
    head = re.search(r'id="head">(.*?)</script>', page, re.S)[1]
    assert evil in json.loads(head)["title"]
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
    assert "2 runs, none flagged" in index
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


def test_an_index_has_a_column_for_what_differs_and_flags_who_is_lost(run, another):
    other = read_run(another)
    other = replace(other, told=replace(other.told, config={**other.told.config, "sigma_hit": 0.3, "filter": "<b>"}))
    page = index([run, other], ["a.html", "b.html"])
    assert "2 runs, 1 flagged" in page
    assert "⚑ lost at the end" in page
    assert {"sigma_hit", "filter"} <= set(re.findall(r'<button type="button">(.*?)</button>', page))
    assert "&lt;b&gt;" in page
    assert "<b>" not in page
