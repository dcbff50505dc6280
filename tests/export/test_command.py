"""`mcl export` as it is typed."""

import pytest
from PIL import Image
from typer.testing import CliRunner

from pipeline.cli import app, exporting
from pipeline.export.figures.kinds import FIGURES
from pipeline.export.files import MOMENTS
from pipeline.export.movies import CAMERAS
from pipeline.export.theme import THEMES


@pytest.fixture
def typed():
    return lambda *args: CliRunner().invoke(app, [str(arg) for arg in args])


def test_several_files_at_once(typed, folder, tmp_path):
    outputs = [tmp_path / name for name in ("a.tum", "b.csv", "c.png")]
    done = typed("export", folder.path, *(word for path in outputs for word in ("-o", path)), "--at", "5")
    assert done.exit_code == 1  # a time is for pictures only: nothing is written before that is known
    assert list(tmp_path.iterdir()) == []
    done = typed("export", folder.path, *(word for path in outputs for word in ("-o", path)))
    assert done.exit_code == 0
    assert done.stdout.splitlines() == [str(path) for path in outputs]
    assert all(path.stat().st_size > 1000 for path in outputs)


def test_a_damaged_recording_is_exported_with_a_note(typed, folder, tmp_path):
    whole = folder.recording.read_bytes()
    (tmp_path / "cut.rrd").write_bytes(whole[: int(len(whole) * 0.5)])
    done = typed("export", tmp_path / "cut.rrd", "-o", tmp_path / "cut.csv")
    assert done.exit_code == 0
    assert "cut short" in done.stderr
    assert 50 < len((tmp_path / "cut.csv").read_text().splitlines()) < 151


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ((), 2, "give --output"),
        (("-o", "a.png", "--raw", "raw"), 2, "give --output"),
        (("-o", "a.png", "--size", "big"), 2, "WIDTHxHEIGHT"),
        (("-o", "a.gif", "--speed", "quick"), 2, "auto or a number"),
        (("-o", "a.gif", "--speed", "nan"), 2, "auto or a number"),
        (("-o", "a.xyz"), 1, "suffix"),
        (("-o", "a.png", "--at", "99999"), 1, "no estimate at"),
        (("-o", "nosuch/a.png"), 1, "folder to write to"),
    ],
)
def test_what_cannot_be(typed, folder, tmp_path, monkeypatch, words, code, said):
    monkeypatch.chdir(tmp_path)
    done = typed("export", folder.path, *words)
    assert done.exit_code == code
    assert said in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_figure_for_a_paper_is_one_command(typed, folder, tmp_path):
    done = typed("export", folder.path, "-o", tmp_path / "figure.pdf")
    assert done.exit_code == 0, done.stderr
    assert done.stdout.split() == [str(tmp_path / "figure.pdf")]
    assert (tmp_path / "figure.pdf").read_bytes().startswith(b"%PDF")


def test_every_wish_reaches_the_file(typed, folder, tmp_path):
    words = ("--figure", "headings", "--at", "4", "--size", "60x40mm", "--dpi", "127", "--theme", "dark")
    assert typed("export", folder.path, "-o", tmp_path / "a.png", *words).exit_code == 0
    shown = Image.open(tmp_path / "a.png").convert("RGB")
    assert (shown.size, shown.getpixel((0, 0))) == ((300, 200), THEMES["dark"].ground)
    words = ("--speed", "auto", "--camera", "follow", "--fps", "2", "--size", "320x240")
    assert typed("export", folder.path, "-o", tmp_path / "a.gif", *words).exit_code == 0
    assert Image.open(tmp_path / "a.gif").size == (320, 240)


def test_what_the_command_offers_is_what_there_is():
    assert {one.value for one in exporting.Figure} == {*FIGURES, MOMENTS}
    assert {one.value for one in exporting.Theme} == set(THEMES)
    assert {one.value for one in exporting.Camera} == set(CAMERAS)
