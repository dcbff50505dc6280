"""Pictures show what the recording holds, where it is, in its colours."""

import builtins
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from pipeline.errors import MclError
from pipeline.export.files import Wishes, export
from pipeline.export.legend import entries
from pipeline.export.movies import Film, movie
from pipeline.export.pictures import Painter, full, sheet, thumbnail
from pipeline.export.run import key_moments
from pipeline.export.theme import THEMES
from pipeline.inspect import RecordedEvent
from pipeline.recording import palette


def near(picture, colour, x, y, radius=12):
    """Whether a colour is near a place of the picture, counted from its lower left corner."""
    row, column = picture.shape[0] - round(y), round(x)
    cut = picture[max(row - radius, 0) : row + radius, max(column - radius, 0) : column + radius].astype(int)
    return bool((np.abs(cut - colour).max(axis=-1) < 40).any())


def test_the_robot_and_the_truth_stand_where_they_are(run):
    painter = Painter(run, full(1280, 720))
    for row in (20, 80, 149):
        picture = painter.draw(row)
        assert picture.shape == (720, 1280, 3)
        assert near(picture, palette.ESTIMATE, *painter.whole.pixels(run.scenes.estimates[row]))
        assert near(picture, palette.TRUTH, *painter.whole.pixels(run.scenes.truth[row]))


def test_walls_are_black_where_the_map_has_them(run):
    painter = Painter(run, full(1280, 720))
    wall = run.scenes.grid.to_map([2.3, 8.0, 0.0])  # within the thick wall on the left
    x, y = painter.whole.pixels(wall)
    picture = painter.draw(149)
    assert picture[720 - round(y), round(x)].max() < 60
    x, y = painter.whole.pixels(run.scenes.grid.to_map([14.0, 14.5, 0.0]))
    assert tuple(picture[720 - round(y), round(x)]) == palette.UNKNOWN


def test_only_the_path_until_then_is_drawn(run):
    painter = Painter(run, full(1280, 720))
    x, y = painter.whole.pixels(run.scenes.estimates[100])
    assert near(painter.draw(110), palette.ESTIMATE, x, y, 4)
    assert not near(painter.draw(20), palette.ESTIMATE, x, y, 4)


def test_key_moments_are_start_events_and_end(run):
    moments = key_moments(run)
    assert [(m.title, m.row) for m in moments] == [("start", 0), ("converged", 46), ("lost", 104), ("end", 149)]
    assert moments[2].sentence == "The map explains 40 % of the beams"
    assert run.sentence(60) == "One hypothesis is left"


def test_a_picture_belongs_to_its_sentence(run):
    at = float(run.scenes.times[105])
    found = RecordedEvent(105, at, "found", "INFO", "Found again")
    again = replace(run, told=replace(run.told, events=(*run.told.events, found)))
    lost, set_right = key_moments(again)[2:4]
    assert (lost.title, lost.row, lost.sentence) == ("lost", 104, "The map explains 40 % of the beams")
    assert (set_right.title, set_right.row, set_right.sentence) == ("found", 105, "Found again")


@pytest.mark.parametrize("count", [2, 3])
def test_a_sheet_says_what_its_colours_mean(run, count):
    picture = sheet(run, key_moments(run)[:count], 1600)
    # Of three pictures the fourth place is free; below two there is no place but the last lines.
    legend = picture[picture.shape[0] // 2 :, 805:] if count == 3 else picture[-40:]
    for _, colours in entries(run.scenes, THEMES["print"]):
        assert any((legend == colour).all(axis=-1).sum() >= 5 for colour in colours)


def test_a_run_s_legend_has_what_the_run_has(run):
    assert {"truth", "no return (stubs)"} <= {words for words, _ in entries(run.scenes, THEMES["print"])}
    blind = replace(run.scenes, truth=np.full_like(run.scenes.truth, np.nan))
    assert "truth" not in {words for words, _ in entries(blind, THEMES["print"])}


def test_a_sheet_and_a_moment_are_files(run, tmp_path):
    export(run, tmp_path / "sheet.png")
    export(run, tmp_path / "at.png", Wishes(at=[10.0], size=(640, 360)))
    export(run, tmp_path / "some.jpg", Wishes(at=[1.0, 2.0, 3.0]))
    assert Image.open(tmp_path / "sheet.png").size[0] == 1600
    assert Image.open(tmp_path / "at.png").size == (640, 360)
    assert Image.open(tmp_path / "some.jpg").size[0] == 1600
    assert thumbnail(run, 149, 320, 200).shape == (200, 320, 3)


@pytest.mark.parametrize("suffix", [".gif", ".webp"])
def test_a_movie_shows_the_whole_run(run, tmp_path, suffix):
    path = tmp_path / f"run{suffix}"
    export(run, path, Wishes(size=(400, 300), speed=10.0, fps=5))
    shown = Image.open(path)
    # 29.8 s at ten times the speed are 2.98 s, and the end stays a second; equal pictures may have become one.
    duration = 0
    for k in range(shown.n_frames):
        shown.seek(k)
        shown.load()
        duration += shown.info["duration"]
    assert shown.size == (400, 300)
    assert duration == pytest.approx(4200, abs=300)


def test_an_mp4_is_h264_of_even_size(run, tmp_path):
    av = pytest.importorskip("av")
    export(run, tmp_path / "run.mp4", Wishes(size=(401, 301), speed=10.0, fps=10))
    with av.open(str(tmp_path / "run.mp4")) as file:
        (stream,) = file.streams.video
        assert (stream.codec_context.name, stream.width, stream.height) == ("h264", 400, 300)
        assert sum(1 for _ in file.decode(stream)) == 41


def test_without_pyav_an_mp4_is_refused_in_a_line(run, tmp_path, monkeypatch):
    real = builtins.__import__

    def without(name, *rest):
        if name == "av":
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MclError, match="needs PyAV"):
        export(run, tmp_path / "run.mp4")
    assert list(tmp_path.iterdir()) == []


def test_a_movie_that_is_stopped_leaves_nothing(run, tmp_path):
    def stop(rows, total, label):
        yield rows[0]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(run, tmp_path / "run.gif", Wishes(size=(320, 320)), progress=stop)
    assert list(tmp_path.iterdir()) == []
    movie(run, tmp_path / "run.gif", Film(320, 320, 100.0, 5, "whole", THEMES["print"]))
    assert (tmp_path / "run.gif").exists()
