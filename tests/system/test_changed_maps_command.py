"""Wrong maps, calibration and kept runs from the command line: asked for, told, drawn."""

from __future__ import annotations

import json
from pathlib import Path

from commands import FEW, Command, Journey


def test_shares_of_the_wall_are_compared_and_judged(typed_here: Command, journey: Journey, tmp_path: Path) -> None:
    """Runs that are kept are told again without being run, in JSON and as a picture of the other kind."""
    asked = ("--perturb-map", "0,0.2", "--perturb-map", "unknown:0.6", "--calibration", "--keep", tmp_path / "kept")
    options = (*FEW, "--runs", 1, "--jobs", 1, *asked, "--plot", tmp_path / "plot.png", "--force")
    said = typed_here("evaluate", journey.short, *options).stdout
    changed = said.partition("\nmaps made wrong\n")[2].partition("\nright, where")[0].splitlines()[1:]
    assert [line.split()[1:3] for line in changed] == [["unchanged", "0"], ["mixed", "20"], ["unknown", "60"]]
    assert abs(float(changed[2].split()[3]) - 60) < 3
    for heading in ("right, where a probability was stated", "scores, less is better", "errors against covariances"):
        assert heading in said
    first, files = (tmp_path / "plot.png").read_bytes(), sorted((tmp_path / "kept").iterdir())
    assert len(files) == 3
    plain = json.loads(typed_here("evaluate", journey.short, *options, "--json").stdout)
    assert sorted((tmp_path / "kept").iterdir()) == files
    variants = plain["variants"]
    assert [variant["values"]["map"] for variant in variants] == ["unchanged", "mixed:0.2", "unknown:0.6"]
    right = [variant["logs"]["short"]["scans_right"]["median"] for variant in variants]
    assert right[0] > 0.5
    assert list(plain["calibration"]) == [f"short, {name}" for name in ("unchanged", "mixed:0.2", "unknown:0.6")]
    scans = plain["calibration"]["short, unchanged"]
    assert scans["scans"] == variants[0]["logs"]["short"]["seeds"][0]["scored"]
    assert abs(scans["base_rate"]["value"] - right[0]) < 1e-9
    without = [word for word in options if word != "--calibration"]
    typed_here("evaluate", journey.short, *without)
    assert (tmp_path / "plot.png").read_bytes() != first
