"""`mcl export` as it is typed."""

import pytest
from typer.testing import CliRunner

from pipeline.cli import app


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
