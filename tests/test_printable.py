"""What a terminal might obey is written out, and everything else stays."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline import console
from pipeline.cli import app
from pipeline.cli.lines import columns, facts
from pipeline.errors import MclError
from pipeline.printable import one_line, printable
from recordings import UPRIGHT, Recording

EVIL = "\x1b[2J\x1b]0;owned\x07/scan\u202e\r\x9b31m\u2028"


@pytest.mark.parametrize("text", ["", "office", "Büro 東京 é — 0,5 m²", "two\nlines\tand a tab", "/scan_front"])
def test_what_is_harmless_stays(text: str) -> None:
    assert printable(text) == text


def test_what_is_not_is_written_out() -> None:
    assert printable(EVIL) == "\\x1b[2J\\x1b]0;owned\\x07/scan\\u202e\\x0d\\x9b31m\\u2028"
    assert one_line("a\nb\tc") == "a\\nb\\tc"
    assert one_line("plain") == "plain"


def test_nothing_obeys_on_the_way_to_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    console.note(EVIL)
    console.result(EVIL)
    console.error(f"{EVIL}\nerror: forged")
    console.table("[red]title", ["name"], [[f"[blink]{EVIL}"]], stdout=True)
    console.result(facts(EVIL, [("name", f"{EVIL}\nforged")]))
    console.result(columns(EVIL, [(EVIL, "1\n2")]))
    console.emit_json({"name": EVIL})
    said = "".join(capsys.readouterr())
    assert not set(said) & set("\x1b\x07\r\x9b\u202e\u2028")
    assert "[blink]" in said
    assert "[red]title" in said
    assert "\nforged" not in said
    assert "\nerror: forged" not in said


def test_an_error_is_one_line_whatever_is_in_it() -> None:
    assert str(MclError("no topic /a\n\x1b[31m", path=Path("b\nc.mcap"))) == "b\\nc.mcap: no topic /a\\n\\x1b[31m"


@pytest.mark.parametrize("command", ["check", "odometry", "localize", "convert"])
def test_names_in_a_recording_are_shown_and_not_obeyed(command: str, tmp_path: Path) -> None:
    recording = Recording()
    frame = f"laser{EVIL}"
    recording.transforms(("base_footprint", frame, (0.0, 0.0, 0.0), UPRIGHT))
    for k in range(30):
        recording.odometry(k * 10**8, 0.05 * k, 0.0, 0.0, topic=f"/odom{EVIL}")
        for topic in (f"/scan{EVIL}", "/scan_b\nerror: forged"):
            recording.scan(k * 10**8, [1.0, 2.0, 3.0], topic=topic, frame=frame)
    path = recording.write(tmp_path / "evil\x1b[31m..mcap")
    out = {
        "convert": ("-o", tmp_path / "new.mcap"),
        "localize": ("-o", tmp_path / "run"),
        "check": ("-o", tmp_path / "a.html"),
    }
    done = CliRunner().invoke(app, [command, str(path), *map(str, out.get(command, ()))])
    assert done.exit_code in (0, 1), done.output
    assert not set(done.stdout + done.stderr) & set("\x1b\x07\r\x9b\u202e\u2028")
    assert not [line for line in done.stderr.splitlines() if line.startswith("error: forged")]
    assert {p.name for p in tmp_path.iterdir()} <= {path.name, "new.mcap", "run", "a.html"}
