"""From a log to a preset: the whole way, and what stands in it."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.config import Config, load_config
from pipeline.errors import MclError
from pipeline.logs.messages import Log
from pipeline.recording.rrd_file import read_rrd
from pipeline.tune import Tuning, plane, preset, residuals, table, tune
from pipeline.tune.learning import PARAMETERS

FEW = Config(max_particles=1000, min_particles=500, recovery="none")


def first(log: Log, n: int) -> Log:
    return dataclasses.replace(log, stamps=log.stamps[:n], odometry=log.odometry[:n], ranges=log.ranges[:n])


def at_truth(log: Log) -> Config:
    """Starts where the robot was, so that few particles do: finding it is not what is tested here."""
    assert log.ground_truth is not None
    x, y, yaw = log.ground_truth.poses[0]
    return FEW.model_copy(update={"init": "pose", "initial_pose": (float(x), float(y), float(yaw))})


@pytest.fixture(scope="module")
def learned(office: Log) -> Tuning:
    return tune([first(office, 160)], at_truth(office), seed=1)


def test_the_office_is_learned(learned: Tuning) -> None:
    """Its laser errs by 1 to 2 cm and its map has no smeared walls: all less than the defaults allow for."""
    assert learned.after.sigma_hit < learned.before.sigma_hit
    assert learned.after.range_bias is not None
    assert abs(learned.after.range_bias) < 0.2
    for part in (0, 1):
        assert learned.after_scores.likelihood[part] > learned.before_scores.likelihood[part]
        assert learned.after_scores.evidence[part] > learned.before_scores.evidence[part]
    assert len(learned.thresholds) >= 5
    assert np.diff(learned.history).min() >= -1e-12


def test_a_preset_comes_back_as_what_was_learned(learned: Tuning, tmp_path: Path) -> None:
    path = tmp_path / "office.yaml"
    path.write_text(preset(learned))
    back = load_config(path)
    for name in PARAMETERS:
        assert getattr(back, name) == pytest.approx(getattr(learned.after, name), rel=1e-3), name
    assert back.max_particles == FEW.max_particles  # as the log was run
    assert back.init == Config().init  # where one log began says nothing of the next
    assert back.initial_pose is None
    assert "office" in path.read_text().splitlines()[0]


def test_a_table_names_every_parameter(learned: Tuning) -> None:
    assert [row[0] for row in table(learned)[: len(PARAMETERS)]] == list(PARAMETERS)
    json.dumps(learned.to_dict())


def test_pictures_show_densities(learned: Tuning) -> None:
    found = residuals(learned.readings, learned.before, learned.after)
    step = found.at[1] - found.at[0]
    for density in (found.measured, found.before, found.after):
        assert 0.5 < density.sum() * step <= 1.0  # what lies outside is missing, and nothing more
    both = plane(learned.readings, learned.after)
    assert both.measured.shape == both.fitted.shape
    assert np.nanmax(both.measured) > 1.0


def test_the_same_seed_learns_the_same(office: Log) -> None:
    short, config = first(office, 50), at_truth(office)
    assert preset(tune([short], config)) == preset(tune([short], config))


def test_the_command_writes_all_that_it_is_asked_for(
    learned: Tuning, office: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    monkeypatch.setattr(
        "pipeline.tune.tune", lambda logs, config, **options: asked.append((config, options)) or learned
    )
    files = [tmp_path / name for name in ("preset.yaml", "plot.png", "fit.rrd")]
    call = ["tune", str(office.path), "-o", str(files[0]), "--plot", str(files[1]), "--record", str(files[2]), "--json"]
    done = CliRunner().invoke(app, [*call, "--seed", "7", "--rounds", "2", "--set", "z_rand=0.2"])
    assert done.exit_code == 0, done.output
    ((config, options),) = asked
    assert config.z_rand == 0.2
    assert (options["seed"], options["rounds"]) == (7, 2)
    assert set(json.loads(done.stdout)["after"]) == set(PARAMETERS)
    assert load_config(files[0]).sigma_hit == pytest.approx(learned.after.sigma_hit, rel=1e-3)
    with Image.open(files[1]) as picture:
        assert picture.width > 1000
    entities = {chunk.entity_path for chunk in read_rrd(files[2]).chunks}
    assert {"/fit/residuals/measured", "/fit/plane/fitted", "/fit/preset"} <= entities

    again = CliRunner().invoke(app, call)
    assert again.exit_code == 1
    assert "exists already" in again.stderr
    assert len(asked) == 1  # said before the work, not after


def test_what_was_there_survives_a_failure(
    learned: Tuning, office: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: object, path: Path) -> None:
        path.write_bytes(b"half a pictu")
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr("pipeline.tune.tune", lambda *_, **__: learned)
    monkeypatch.setattr("pipeline.tune.plot", fail)
    old = tmp_path / "old.png"
    old.write_text("as before")
    done = CliRunner().invoke(app, ["tune", str(office.path), "--plot", str(old), "--force"])
    assert done.exit_code == 1
    assert "No space left" in done.stderr
    assert [(path, path.read_text()) for path in tmp_path.iterdir()] == [(old, "as before")]


def test_without_a_file_the_preset_is_printed(learned: Tuning, office: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.tune.tune", lambda *_, **__: learned)
    done = CliRunner().invoke(app, ["tune", str(office.path)])
    assert done.stdout == preset(learned)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda log: dataclasses.replace(log, grid=None), "no map"),
        (lambda log: first(log, 5), "did not converge"),
    ],
)
def test_a_log_that_teaches_nothing_is_named_in_one_line(office: Log, change, said: str) -> None:
    with pytest.raises(MclError, match=said) as caught:
        tune([change(office)], FEW)
    assert caught.value.path == office.path
    assert "\n" not in str(caught.value)


def test_hindsight_is_needed(office: Log) -> None:
    with pytest.raises(MclError, match="hindsight"):
        tune([office], Config(hindsight=False))
