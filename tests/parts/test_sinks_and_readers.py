"""Sinks and readers of a user's own, from a file and from an installed package."""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path

import numpy as np
import pytest

import converters
from pipeline.config import Config, load_config
from pipeline.errors import MclError
from pipeline.localization import localize
from pipeline.logs.messages import Log
from pipeline.parts.sinks import OwnSink, installed_readers, reader_in

READER = """
from converters import cmu

FORMAT = "shouted"
DESCRIPTION = "log in capitals"

def sniff(path, head):
    return head.startswith(b"SHOUTED")

def convert(sources, output, **options):
    plain = output.with_suffix(".log")
    plain.write_text(sources[0].read_text().partition(chr(10))[2])
    return cmu.convert([plain], output, **options)
"""


def test_a_sink_sees_every_step_and_is_closed(office: Log, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "import json\nclass Sink:\n"
        "    def __init__(self, laser, name='seen'):\n        self.seen, self.name = [laser.beams], name\n"
        "    def log(self, step):\n        self.seen.append(step.index)\n"
        f"    def close(self):\n        open('{tmp_path}/' + self.name, 'w').write(json.dumps(self.seen))\n"
    )
    config = Config(max_particles=100, min_particles=100)
    with OwnSink(f"{tmp_path}/mine.py:Sink", laser=office.laser, config=config) as sink:
        localize(office.part(slice(5)), config, sinks=[sink])
    assert json.loads((tmp_path / "seen").read_text()) == [office.laser.beams, 0, 1, 2, 3, 4]


def test_what_goes_wrong_in_a_sink_is_told_with_its_line(office: Log, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("def watch(step):\n    step.nothing\n")
    with pytest.raises(MclError, match=r"AttributeError.*nothing") as caught:
        localize(office.part(slice(2)), Config(max_particles=100), sinks=[OwnSink(f"{tmp_path}/mine.py:watch")])
    assert (caught.value.path, caught.value.line) == (tmp_path / "mine.py", 2)
    with pytest.raises(MclError, match=r"--sink nothing: expected .*a part of your own"):
        OwnSink("nothing")


def test_a_reader_reads_a_format_of_its_own(office: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from pipeline.simulate import sample_dir

    (tmp_path / "shouted.py").write_text(READER)
    (tmp_path / "a.shout").write_text("SHOUTED\n" + text_of(sample_dir() / "office.log.gz"))
    monkeypatch.setattr(converters, "_registered", [])
    assert converters.format_of(tmp_path / "a.shout").FORMAT == "cmu"
    converters.register(reader_in(tmp_path / "shouted.py"))
    assert converters.format_of(tmp_path / "a.shout").FORMAT == "shouted"
    report = converters.convert([tmp_path / "a.shout"], tmp_path / "a.mcap", map_path=sample_dir() / "office.dat.gz")
    assert dataclasses.asdict(report)
    from pipeline.logs.reader import read_log

    np.testing.assert_array_equal(read_log(tmp_path / "a.mcap").ranges, office.ranges)
    (tmp_path / "half.py").write_text("FORMAT = 'x'\ndef sniff(path, head):\n    return True\n")
    with pytest.raises(MclError, match="no DESCRIPTION and no convert"):
        reader_in(tmp_path / "half.py")


def test_a_package_offers_parts_by_entry_points(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    about = tmp_path / "their_lasers-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: their-lasers\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(
        "[mcl_replay.sensor_model]\nlaplace = their_lasers:density\n\n[mcl_replay.reader]\nshouted = their_lasers\n"
    )
    density = "def density(z, expected, spread=0.1):\n    return 0.01 + 0.0 * z\n"
    (tmp_path / "their_lasers.py").write_text(READER + density)
    monkeypatch.syspath_prepend(str(tmp_path))
    config = load_config(None, ["sensor_model=laplace", "sensor_model.spread=0.3"])
    assert (config.sensor_model, config.own) == ("laplace", {"sensor_model.spread": 0.3})
    assert [reader.__name__ for reader in installed_readers()] == ["their_lasers"]
    with pytest.raises(MclError, match="did you mean 'laplace'"):
        load_config(None, ["sensor_model=laplac"])
    sys.modules.pop("their_lasers")
    (tmp_path / "their_lasers.py").write_text(density)
    with pytest.raises(MclError, match="reader shouted has no FORMAT"):
        installed_readers()
    sys.modules.pop("their_lasers")


def text_of(path: Path) -> str:
    import gzip

    return gzip.decompress(path.read_bytes()).decode()
