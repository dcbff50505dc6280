"""Figures for papers: sharp, small, the same every time, and readable on every ground."""

import re
import shutil
import subprocess
import time
import zlib
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from pipeline.errors import MclError
from pipeline.export.figures.errors import sigmas
from pipeline.export.figures.kinds import FIGURES, draw
from pipeline.export.figures.paper import Paper
from pipeline.export.figures.sensor import WHOLE, recorded_density
from pipeline.export.figures.ways import labels
from pipeline.export.files import Wishes, export
from pipeline.export.movies import Film, _shots, movie, pace
from pipeline.export.pictures import Painter, full, sheet
from pipeline.export.run import key_moments
from pipeline.export.sizes import size_of
from pipeline.export.theme import THEMES
from pipeline.recording import entities, palette

AA = 4.5
"""Contrast that WCAG 2.1 asks of text, at level AA."""


def luminance(rgb):
    """Relative luminance, as WCAG 2.1 defines it, of sRGB colours (..., 3) from 0 to 1."""
    rgb = np.asarray(rgb, float)
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return linear @ (0.2126, 0.7152, 0.0722)


@pytest.fixture
def contrasts(monkeypatch):
    """Of every text that is drawn from now on: the words, and their least contrast with a pixel that they cover."""
    found, drawn = [], RendererAgg.draw_text

    def measured(self, gc, x, y, words, font, angle, *rest, **more):
        wide, high, _ = self.get_text_width_height_descent(words, font, False)
        if angle == 90:
            left, top, wide, high = x - high, y - wide, high, wide
        else:
            left, top = x, y - high
        below = np.asarray(self.buffer_rgba())[..., :3]
        box = below[max(int(top), 0) : int(top + high) + 1, max(int(left), 0) : int(left + wide) + 1] / 255.0
        ink, ground = luminance(to_rgb(gc.get_rgb())), luminance(box)
        low, high_ = np.minimum(ink, ground), np.maximum(ink, ground)
        if words.strip():
            found.append((words, float(((high_ + 0.05) / (low + 0.05)).min())))
        return drawn(self, gc, x, y, words, font, angle, *rest, **more)

    monkeypatch.setattr(RendererAgg, "draw_text", measured)
    return found


def figure(kind, runs, name="print", width="column", at=None):
    paper = Paper(size_of(width), THEMES[name], 150, False)
    with paper.styled():
        made = draw(kind, runs, at, paper)
        canvas = FigureCanvasAgg(made)
        canvas.draw()
    return made


def of(kind, run):
    return [run, replace(run, told=replace(run.told, seed=8))] if kind == "compare" else [run]


@pytest.mark.parametrize("name", THEMES)
@pytest.mark.parametrize("kind", FIGURES)
def test_all_text_of_figures_can_be_read(run, contrasts, kind, name):
    figure(kind, of(kind, run), name)
    assert len(contrasts) > 8
    assert [one for one in contrasts if one[1] < AA] == []


@pytest.mark.parametrize("name", THEMES)
def test_all_text_of_pictures_can_be_read(run, contrasts, name):
    painter = Painter(run, full(1280, 720), THEMES[name])
    for row in (0, 20, 104, 149):  # at the start there are hypotheses, with their shares beside them
        painter.draw(row, sentence=run.sentence(row), factor=8.0)
    sheet(run, key_moments(run), 1600, THEMES[name])
    assert any("%" in words for words, _ in contrasts)
    assert [one for one in contrasts if one[1] < AA] == []


def test_the_measure_of_contrast_is_that_of_wcag(contrasts):
    assert (luminance((1, 1, 1)) + 0.05) / (luminance((0, 0, 0)) + 0.05) == pytest.approx(21.0)
    bad = Figure()
    bad.text(0.5, 0.5, "grey", color="#999999")  # 2.85 on white, as everybody's checker says
    FigureCanvasAgg(bad).draw()
    assert contrasts == [("grey", pytest.approx(2.85, abs=0.01))]


@pytest.mark.parametrize("width", ["column", "page"])
@pytest.mark.parametrize("kind", FIGURES)
def test_no_text_overlaps_or_leaves_the_figure(run, kind, width):
    made = figure(kind, of(kind, run), width=width)
    renderer = made.canvas.get_renderer()
    ticks = {
        id(label)
        for axes in made.axes
        for axis in (axes.xaxis, axes.yaxis)
        for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks())
        for label in (tick.label1, tick.label2)
    }
    boxes = [
        (text.get_text(), text.get_window_extent(renderer))
        for text in made.findobj(Text)
        if text.get_visible() and text.get_text().strip() and id(text) not in ticks
    ]
    assert len(boxes) > 4
    for k, (words, box) in enumerate(boxes):
        assert -1 <= box.x0 < box.x1 <= made.bbox.width + 1, words
        assert -1 <= box.y0 < box.y1 <= made.bbox.height + 1, words
        for others, other in boxes[:k]:
            across = min(box.x1, other.x1) - max(box.x0, other.x0)
            upwards = min(box.y1, other.y1) - max(box.y0, other.y0)
            assert min(across, upwards) < 1.5, (words, others)


@pytest.mark.parametrize("kind", FIGURES)
def test_vectors_are_small_and_the_same_every_time(run, tmp_path, kind):
    for suffix in ("pdf", "svg"):
        first, again = tmp_path / f"first.{suffix}", tmp_path / f"again.{suffix}"
        export(of(kind, run), first, Wishes(figure=kind))
        time.sleep(1.01 if kind == "headings" else 0)  # a date, or a font's, would have gone on
        export(of(kind, run), again, Wishes(figure=kind))
        assert first.read_bytes() == again.read_bytes()
        assert 5_000 < first.stat().st_size < 1_000_000
    if shutil.which("pdftoppm"):
        pdf = first.with_suffix(".pdf")
        asked = ("pdfinfo", pdf), ("pdffonts", pdf), ("pdftoppm", "-r", "50", "-png", pdf, tmp_path / "page")
        ran = [subprocess.run(words, capture_output=True, text=True, check=True) for words in asked]
        assert all(done.stderr == "" for done in ran)
        assert re.search(r"Page size: +238\.", ran[0].stdout)  # 84 mm
        fonts = ran[1].stdout.splitlines()[2:]
        assert fonts
        assert all(re.search(r"yes +yes +yes", font) for font in fonts)  # embedded, a subset, with a map to Unicode


def test_an_svg_needs_no_font_and_no_other_file(run, tmp_path):
    export(run, tmp_path / "path.svg")
    text = (tmp_path / "path.svg").read_text()
    assert "<text" not in text
    assert "font-family" not in text
    assert set(re.findall(r'href="([#d])', text)) == {"#", "d"}  # parts of itself, and the map as an image


def test_the_map_of_a_pdf_is_an_image_and_the_paths_are_not(run, tmp_path):
    export(run, tmp_path / "path.pdf")
    whole = (tmp_path / "path.pdf").read_bytes()
    assert whole.count(b"/Subtype /Image") == 1
    streams = [zlib.decompress(part) for part in re.findall(rb"stream\r?\n(x.*?)\r?\nendstream", whole, re.DOTALL)]
    assert sum(stream.count(b" l\n") for stream in streams) > 100  # straight lines


def test_what_is_drawn_follows_from_the_ending(run, tmp_path):
    def title(wishes, runs=run):
        export(runs, tmp_path / "out.pdf", wishes, force=True)
        return re.search(rb"/Title \((.*?)\)", (tmp_path / "out.pdf").read_bytes())[1].decode().rpartition(": ")[2]

    assert title(Wishes()) == "path"
    assert title(Wishes(at=[3.0])) == "belief"
    assert title(Wishes(at=[3.0], figure="headings")) == "headings"
    assert title(Wishes(), of("compare", run)) == "compare"


def test_sizes_are_those_asked_for(run, tmp_path):
    for size, dpi, pixels in (("column", 100, 331), ("page", 100, 685), ("100x80mm", 254, 1000), ("900x600", 300, 900)):
        export(run, tmp_path / "out.png", Wishes(figure="error", size=size, dpi=dpi), force=True)
        shown = Image.open(tmp_path / "out.png")
        assert abs(shown.width - pixels) <= 1
        assert shown.height == {"100x80mm": 800, "900x600": 600}.get(size, shown.height)
    export(run, tmp_path / "dark.png", Wishes(figure="path", theme="dark"))
    assert Image.open(tmp_path / "dark.png").convert("RGB").getpixel((0, 0)) == THEMES["dark"].ground


@pytest.mark.parametrize(
    ("name", "wishes", "said"),
    [
        ("a.pdf", Wishes(figure="moments"), "name a .png"),
        ("a.pdf", Wishes(figure="picture"), "name one of path, error"),
        ("a.gif", Wishes(figure="path"), "--figure asks for a picture"),
        ("a.pdf", Wishes(figure="path", at=[1.0]), "leave --at out"),
        ("a.pdf", Wishes(at=[1.0, 2.0]), "give --at once"),
        ("a.svg", Wishes(dpi=300), "--dpi asks for pixels"),
        ("a.png", Wishes(size="column"), "size is in pixels"),
        ("a.pdf", Wishes(size="huge"), "is no size"),
        ("a.pdf", Wishes(size="10x10mm"), "millimetres along a side"),
        ("a.pdf", Wishes(theme="pink"), "no theme"),
        ("a.gif", Wishes(camera="drone"), "no camera"),
        ("a.pdf", Wishes(figure="compare"), "2 to 6 runs"),
        ("a.png", Wishes(dpi=300), "--dpi is for a figure"),
    ],
)
def test_what_cannot_be_drawn_is_said_in_a_line(run, tmp_path, name, wishes, said):
    with pytest.raises(MclError, match=said):
        export(run, tmp_path / name, wishes)
    assert list(tmp_path.iterdir()) == []


def test_several_runs_are_compared_and_named_by_what_differs(run, tmp_path):
    other = of("compare", run)[1]
    with pytest.raises(MclError, match="made of one run"):
        export([run, other], tmp_path / "a.png", Wishes(figure="path"))
    assert labels([run, other]) == ["seed 7", "seed 8"]
    field = replace(run, told=replace(run.told, config={**run.told.config, "sensor_model": "likelihood_field"}))
    assert labels([run, field]) == ["sensor_model=beam", "sensor_model=likelihood_field"]
    assert labels([run, run]) == ["run", "run"]  # the name of the folder
    elsewhere = replace(run, told=replace(run.told, map_sha256="other"))
    with pytest.raises(MclError, match="different maps"):
        export([run, elsewhere], tmp_path / "a.pdf")


def test_the_error_is_shown_with_the_truth_and_the_spread_without(run):
    position, heading = figure("error", [run]).axes
    assert (position.get_ylabel(), heading.get_ylabel()) == ("position error (m)", "heading error (deg)")
    drawn = next(line for line in position.lines if line.get_label() == "error")
    expected = np.hypot(*(run.told.poses[:, :2] - run.scenes.truth[:, :2]).T)
    assert np.nanmax(drawn.get_ydata()) == pytest.approx(np.nanmax(expected), rel=1e-6)
    blind = replace(run, scenes=replace(run.scenes, truth=np.full_like(run.scenes.truth, np.nan)))
    position, _ = figure("error", [blind]).axes
    assert position.get_ylabel() == "position spread (m)"
    assert "error" not in {line.get_label() for line in position.lines}


def test_two_sigma_is_along_the_longer_axis(run):
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    covariance = np.zeros((len(run.scenes), 3, 3))
    covariance[:, :2, :2] = turn @ np.diag([0.04, 0.01]) @ turn.T
    covariance[:, 2, 2] = np.radians(3.0) ** 2
    position, heading = sigmas(replace(run, told=replace(run.told, covariances=covariance)))
    assert np.allclose(position, 0.2)
    assert np.allclose(heading, 3.0)


def test_the_sensor_model_is_read_back_as_it_was_recorded(recorded_sensor):
    run, edges, density = recorded_sensor
    found = recorded_density(run, WHOLE)
    assert np.allclose(found[0], edges, rtol=1e-5)
    assert np.allclose(found[1], density, rtol=0.01)  # both are sums over parts of a bin, of other lengths
    edges, measured = recorded_density(run, entities.MEASURED)
    returned = float((measured * np.diff(edges)).sum())
    assert 0.5 < returned <= 1.0 + 1e-6  # the rest came without return


def test_an_automatic_speed_is_slow_where_something_happens(run):
    events = [float(run.scenes.times[moment.row]) for moment in key_moments(run)[:-1]]
    long = replace(run, told=replace(run.told, times=run.told.times * 30))
    assert {pace(long, at) for at in events} == {2}
    assert pace(long, events[-1] + 3.1) == 4
    assert pace(long, events[-1] + 500.0) == 64  # 15 minutes in 14 s, were there nothing else
    shots = _shots(run, Film(320, 240, "auto", 10, "whole", THEMES["print"]))
    rows = [row for row, _ in shots]
    assert rows == sorted(rows)
    assert (rows[0], rows[-1]) == (0, len(run.scenes) - 1)


def test_a_camera_that_follows_has_the_robot_in_the_middle(run, tmp_path):
    film = Film(640, 360, 20.0, 5, "follow", THEMES["print"])
    movie(run, tmp_path / "run.webp", film)
    shown = Image.open(tmp_path / "run.webp")
    shown.seek(shown.n_frames - 1)
    picture = np.asarray(shown.convert("RGB"))
    box = full(640, 360).map
    x, y = round(box.x + box.width / 2), 360 - round(box.y + box.height / 2)
    middle = picture[y - 25 : y + 25, x - 25 : x + 25].astype(int)
    assert (np.abs(middle - palette.ESTIMATE).max(axis=-1) < 60).any()


def test_a_gif_keeps_the_colours_that_its_legend_names(run, tmp_path):
    export(run, tmp_path / "run.gif", Wishes(size=(800, 450), speed=30.0, fps=5))
    shown = Image.open(tmp_path / "run.gif")
    shown.seek(shown.n_frames - 1)
    colours = {colour for _, colour in shown.convert("RGB").getcolors(1 << 20)}
    assert {palette.ESTIMATE, palette.TRUTH, palette.HIT, palette.HYPOTHESIS, palette.EXPECTED} <= colours


def test_a_webm_is_vp9_and_the_same_every_time(run, tmp_path):
    av = pytest.importorskip("av")
    for name in ("a.webm", "b.webm"):
        export(run, tmp_path / name, Wishes(size=(400, 300), speed=40.0, fps=5))
    assert (tmp_path / "a.webm").read_bytes() == (tmp_path / "b.webm").read_bytes()
    with av.open(str(tmp_path / "a.webm")) as file:
        assert file.streams.video[0].codec_context.name == "vp9"
        assert sum(1 for _ in file.decode(video=0)) == 10
