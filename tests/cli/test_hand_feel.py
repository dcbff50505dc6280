"""What every command has in common: the newest run by name, how much is said, one style of errors, no colours."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline import console
from pipeline.cli import app
from pipeline.printable import seconds

OF_RUNS = (
    ("inspect", "latest"),
    ("view", "latest"),
    ("compare", "latest", "latest"),
    ("export", "latest", "-o", "x.png"),
    ("share", "latest", "-o", "x.html"),
    ("localize", "nosuch.mcap", "--memory", "latest"),
)


@pytest.fixture
def typed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    return lambda *args: CliRunner().invoke(app, list(args), prog_name="mcl")


def recorded(folder: Path, at: int) -> Path:
    folder.mkdir(parents=True)
    (folder / "run.rrd").write_bytes(b"no recording")
    os.utime(folder / "run.rrd", (at, at))
    return folder


@pytest.mark.parametrize("words", OF_RUNS, ids=lambda words: words[0])
def test_latest_is_the_newest_run_in_every_command(typed, words: tuple[str, ...]):
    recorded(Path("recordings/office/a"), 300)
    recorded(Path("recordings/other/b"), 500)
    recorded(Path("first-run"), 400)
    assert "latest: recordings/other/b\n" in typed(*words).stderr
    os.utime("first-run/run.rrd", (600, 600))
    assert "latest: first-run\n" in typed(*words).stderr


@pytest.mark.parametrize("words", OF_RUNS, ids=lambda words: words[0])
def test_without_any_run_it_says_what_makes_one(typed, words: tuple[str, ...]):
    done = typed(*words)
    assert done.exit_code == 1
    assert done.stderr.startswith("error: there is no run yet in recordings/")


def test_a_folder_of_that_name_is_itself(typed):
    recorded(Path("latest"), 100)
    recorded(Path("newer"), 200)
    assert "newer" not in typed("inspect", "latest").stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("localise x", "error: mcl: there is no command 'localise' (did you mean 'localize'?)"),
        ("localize x --sed 3", "error: mcl localize: there is no option --sed (did you mean '--seed'?)"),
        ("localize x --seed -3", "error: mcl localize: --seed: expected a number of at least 0, got -3 ("),
        ("localize x --seed few", "error: mcl localize: --seed: expected a whole number, got few ("),
        ("localize", "error: mcl localize: LOG is missing ("),
        ("convert x", "error: mcl convert: --output is missing ("),
        ("localize x --pose 1,2", "error: mcl localize: '1,2' is not X,Y,YAW"),
        ("demo x", "error: mcl demo: got unexpected extra argument"),
        ("config -q -v", "error: mcl config: --quiet says less and --verbose more"),
    ],
)
def test_bad_usage_is_one_line_in_the_style_of_bad_input(typed, words: str, said: str):
    done = typed(*words.split())
    assert done.exit_code == 2
    assert done.stderr.startswith(said)
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ("config --set sensor_model=model.py", "write model.py:density or model.py:other"),
        ("config corse", "did you mean 'course'?"),
        ("lesson ray", "did you mean 'rays'?"),
    ],
)
def test_what_was_meant_is_named(typed, words: str, meant: str):
    Path("model.py").write_text("def density(z): ...\ndef other(z): ...\ndef _own(z): ...\n")
    assert meant in typed(*words.split()).stderr


def test_quiet_leaves_results_and_errors(typed):
    assert typed("lesson").stderr.startswith("begin with one")
    quiet = typed("lesson", "-q")
    assert quiet.stderr == ""
    assert quiet.stdout == typed("lesson").stdout
    assert typed("inspect", "nosuch", "--quiet").stderr.startswith("error: ")


def test_quiet_shows_no_progress_and_ends_with_its_command(typed):
    typed("lesson", "--quiet")
    assert console.is_quiet()
    assert list(console.progress([1, 2], 2, "")) == [1, 2]
    typed("lesson")
    assert not console.is_quiet()


def test_verbose_says_what_is_decided_and_how_long_it_took(typed):
    assert "done in" not in typed("lesson").stderr
    assert "done in 0.0" in typed("lesson", "-v").stderr
    said = typed("check", "nosuch.mcap", "--set", "max_beams=5", "-v").stderr
    assert "parameters: max_beams=5\n" in said


@pytest.mark.parametrize("words", ["--help", "localize --help", "localise", "inspect nosuch", "lesson"])
def test_what_is_piped_has_no_colours(typed, words: str):
    assert "\x1b" not in typed(*words.split()).output


def test_one_format_of_times():
    assert [seconds(t) for t in (0.071, 1.0, 93.44, 750.0, 8640.0)] == [
        "0.07 s",
        "1.0 s",
        "93.4 s",
        "12.5 min",
        "2.4 h",
    ]
