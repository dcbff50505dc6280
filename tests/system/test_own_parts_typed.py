"""Parts of a user's own, named on the command line."""

from __future__ import annotations

import json
from pathlib import Path

from commands import Command, Journey
from shown import write_shown

from pipeline.config import load_config


def test_own_parameters_are_parameters_like_any_other(typed_here: Command, journey: Journey, tmp_path: Path) -> None:
    examples = write_shown("own_parts.md", tmp_path)
    asked = ["--set", f"sensor_model={examples}/my_laser.py:density", "--set", "sensor_model.spread=0.2"]
    lines = typed_here("config", *asked).stdout.splitlines()
    assert "sensor_model.spread: 0.2" in lines
    assert "sensor_model.hits: 0.8" in lines
    run = tmp_path / "run"
    typed_here("localize", journey.log, *asked, "--particles", 300, "--sink", f"{examples}/watch.py:Watch", "-o", run)
    again = load_config(run / "config.yaml")
    assert again.own == {"sensor_model.spread": 0.2, "sensor_model.hits": 0.8}
    assert load_config(None, ()).own == {}
    told = typed_here("evaluate", journey.log, "--runs", 1, "--jobs", 1, "--particles", 300, "--json", "--vary",
                      "sensor_model.hits=0.6,0.9", *asked).stdout  # fmt: skip
    assert [each["values"] for each in json.loads(told)["variants"]] == [
        {"sensor_model.hits": 0.6},
        {"sensor_model.hits": 0.9},
    ]
    # Whoever looks at a run executes nothing: the part may be gone by then.
    text = (run / "config.yaml").read_text().replace("my_laser", "gone")
    (run / "config.yaml").write_text(text)
    typed_here("inspect", run)
