"""The command line from the inside: what it offers, what it passes on, how it lays out what it says."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline import __version__, console
from pipeline.cli import app
from pipeline.cli.lines import columns, facts, look_at, percent
from pipeline.config import dump_config, load_config, preset_names
from pipeline.errors import MclError

COMMANDS = (
    "demo", "convert", "check", "localize", "inspect", "view", "compare", "evaluate", "tune", "odometry", "simulate",
    "export", "share", "config", "lesson", "bench",
)  # fmt: skip


@pytest.fixture
def typed():
    """Runs a command in this process: quick, but only for what ends well or in bad usage."""
    return lambda *args: CliRunner().invoke(app, list(args))


def test_version(typed):
    done = typed("--version")
    assert done.exit_code == 0
    assert done.stdout == f"mcl-replay {__version__}\n"


def test_help_lists_the_commands_in_the_order_of_first_use(typed):
    lines = typed("--help").stdout.split("Commands:\n")[1].splitlines()
    assert tuple(line.split()[0] for line in lines if line.strip()) == COMMANDS


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_says_what_it_is_for(typed, command):
    shown = typed(command, "--help").stdout.split("Options:\n")[1]
    options = [line.strip() for line in shown.splitlines() if line.startswith("  -")]
    assert options
    continued = shown.splitlines()
    for line in options:
        name, _, meaning = line.partition("  ")
        below = continued[continued.index(f"  {line}") + 1 :][:1]
        assert meaning.strip() or (below and below[0].startswith("      ")), name


@pytest.mark.parametrize("command", COMMANDS)
def test_a_commands_first_sentence_fits_into_the_list(typed, command):
    lines = typed("--help").stdout.splitlines()
    (line,) = (line for line in lines if line.split()[:1] == [command])
    assert line.endswith(".")
    assert not line.endswith("...")


def test_nothing_typed_is_bad_usage_and_shows_the_help(typed):
    done = typed()
    assert done.exit_code == 2
    assert "Commands:" in done.output


def test_config_prints_what_load_config_reads_back(typed, tmp_path: Path):
    file = tmp_path / "mine.yaml"
    file.write_text(typed("config", "course", "--set", "max_beams=12").stdout)
    assert load_config(file) == load_config("course", ["max_beams=12"])


def test_config_explains_every_parameter(typed):
    lines = typed("config").stdout.splitlines()
    for line in dump_config(load_config()).splitlines():
        at = lines.index(line)
        assert lines[at - 1].startswith("# ")
        assert "; default " in lines[at - 1]
        assert lines[at - 2].startswith("# ")


def test_config_shows_a_parameter_alone(typed):
    explained, taken, value = typed("config", "sigma_hit", "--set", "sigma_hit=0.25").stdout.splitlines()
    assert explained.startswith("# ")
    assert taken == "# a number above 0 (m); default 0.15; the book's σ_hit"
    assert value == "sigma_hit: 0.25"


def test_config_shows_all_parameters_with_a_part_of_the_name(typed):
    shown = typed("config", "particles").stdout.splitlines()
    names = [line.partition(":")[0] for line in shown if line and not line.startswith("#")]
    assert names == ["max_particles", "min_particles", "record_particles"]


def test_config_names_what_was_meant(typed):
    assert "did you mean 'sigma_hit'?" in typed("config", "sigma_hti").stderr


def test_config_lists_the_presets(typed):
    lines = typed("config", "--list").stdout.splitlines()
    assert [line.split()[0] for line in lines] == preset_names()
    assert all(len(line.split()) > 3 and len(line) <= 120 for line in lines)
    assert "course report" in next(line for line in lines if line.startswith("course "))


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (MclError("wrong", "mend it", path="a.log", line=3), "error: a.log:3: wrong (mend it)\n"),
        (FileNotFoundError(2, "No such file or directory", "a.log"), "error: a.log: No such file or directory\n"),
        (PermissionError(13, "Permission denied", "a.log"), "error: a.log: Permission denied\n"),
        (OSError("disk on fire"), "error: disk on fire\n"),
        (MemoryError(), "error: not enough memory: fewer particles may do\n"),
    ],
)
def test_what_a_user_can_mend_is_one_line(typed, monkeypatch: pytest.MonkeyPatch, error: Exception, said: str):
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("pipeline.config.load_config", fail)
    done = typed("config")
    assert (done.exit_code, done.stderr, done.stdout) == (1, said, "")


def test_our_own_mistakes_are_not_hidden(typed, monkeypatch: pytest.MonkeyPatch):
    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("pipeline.config.load_config", fail)
    assert isinstance(typed("config").exception, ZeroDivisionError)


def test_ctrl_c_is_exit_code_130(typed, monkeypatch: pytest.MonkeyPatch):
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("pipeline.config.load_config", interrupt)
    done = typed("config")
    assert (done.exit_code, done.stderr) == (130, "error: interrupted\n")


def test_a_reader_that_has_seen_enough_gets_no_traceback():
    command = [sys.executable, "-m", "pipeline.cli", "config"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    assert process.stderr.read() == ""
    process.stderr.close()
    process.wait(timeout=60)


def test_the_script_and_the_module_are_the_same():
    script = Path(sys.executable).with_name("mcl")
    if not script.exists():
        pytest.skip("mcl is not installed beside this Python")
    for command in ([script], [sys.executable, "-m", "pipeline.cli"]):
        done = subprocess.run([*command, "--version"], capture_output=True, text=True)
        assert done.stdout == f"mcl-replay {__version__}\n"


def test_errors_are_coloured_for_people_only(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.delenv("NO_COLOR", raising=False)
    console.error("plain in a pipe")
    assert capsys.readouterr().err == "error: plain in a pipe\n"
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    console.error("red")
    assert "\x1b[" in capsys.readouterr().err
    monkeypatch.setenv("NO_COLOR", "1")
    console.error("as they wish")
    assert capsys.readouterr().err == "error: as they wish\n"


def test_json_has_no_nan(capsys: pytest.CaptureFixture[str]):
    console.emit_json({"a": float("nan"), "b": [float("inf"), 1.0]})
    assert capsys.readouterr().out.split() == ["{", '"a":', "null,", '"b":', "[", "null,", "1.0", "]", "}"]


def test_facts_are_aligned():
    assert facts("log", [("scans", "7"), ("end pose", "x 1")]) == "log\n  scans     7\n  end pose  x 1"


def test_columns_align_numbers_right_and_words_left():
    told = columns("events", [("0.5 s", "1", "found", "Found it."), ("10.0 s", "12", "lost", "Lost.")])
    assert told == "events\n   0.5 s   1  found  Found it.\n  10.0 s  12  lost   Lost."


def test_a_heading_lines_up_with_its_column():
    told = columns("runs", [("office", "20/20", "-"), ("hall", "9/20", "0.1")], ("log", "success", "error (m)"))
    assert told == "runs\n  log     success  error (m)\n  office    20/20          -\n  hall       9/20        0.1"


def test_columns_without_rows_are_their_title():
    assert columns("events", []) == "events"


def test_the_line_that_opens_a_recording_can_be_pasted():
    line = look_at(Path("läuf 2/run.rrd")).removeprefix("look at it:  ")
    assert shlex.split(line)[1:] == ["läuf 2/run.rrd"]


def test_percent():
    assert [percent(share) for share in (0.0, 0.954, 1.0)] == ["0 %", "95 %", "100 %"]


def test_no_color_reaches_tables():
    program = "from pipeline import console; console.table('t', ('a', 'b'), [('1', '2')])"
    done = subprocess.run(
        [sys.executable, "-c", program], env=os.environ | {"NO_COLOR": "1"}, capture_output=True, text=True
    )
    assert "\x1b[" not in done.stderr
    assert done.stdout == ""
