"""From a log to a file of nav2's: what is learned for AMCL, why, and that the file comes back as what was meant."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from ruamel.yaml import YAML
from typer.testing import CliRunner

from pipeline import nav2
from pipeline.check.amcl_file import checked, findings_of_file
from pipeline.cli import app
from pipeline.config import Config, load_config
from pipeline.localization import localize
from pipeline.logs.messages import Log
from pipeline.tune import Tuning, tune
from pipeline.tune.amcl import FREER, WILD, amcl_updates, moments, surprise
from pipeline.tune.learning import PARAMETERS

ROBOT = Path(__file__).parents[1] / "nav2" / "robot.yaml"
LEARNED = {"alpha1", "alpha2", "alpha3", "alpha4", "sigma_hit", "z_hit", "z_rand", "update_min_d", "update_min_a"}


@pytest.fixture(scope="module")
def learned(office: Log) -> Tuning:
    assert office.ground_truth is not None
    x, y, yaw = office.ground_truth.poses[0]
    start = (float(x), float(y), float(yaw))
    few = Config(max_particles=1000, min_particles=500, recovery="none", init="pose", initial_pose=start)  # type: ignore[call-arg]
    return tune([office.part(slice(250))], few, seed=1)


@pytest.fixture
def type_tune(learned: Tuning, office: Log, monkeypatch: pytest.MonkeyPatch):
    asked = []
    monkeypatch.setattr("pipeline.tune.tune", lambda *_, **__: asked.append(1) or learned)

    def run(*words: object) -> tuple[Result, int]:
        return CliRunner().invoke(app, ["tune", str(office.path), *map(str, words)]), len(asked)

    return run


def given(path: Path) -> dict[str, Any]:
    return dict(nav2.nodes_in(YAML(typ="safe").load(path)))["amcl"]


def test_amcl_gets_only_what_amcl_has(learned: Tuning) -> None:
    assert LEARNED <= learned.amcl.values.keys() <= nav2.PARAMETERS.keys()
    for name, value in learned.amcl.values.items():
        parameter = nav2.PARAMETERS[name]
        assert not parameter.wrong_type(value), name
        assert not parameter.wrong_value(value), name
        assert YAML(typ="safe").load(parameter.written(value)) == value  # what is written is what is meant
    assert learned.amcl.values["z_hit"] + learned.amcl.values["z_rand"] == pytest.approx(1.0)


def test_a_file_of_nav2s_is_changed_in_place_and_nowhere_else(learned: Tuning, type_tune, tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text(ROBOT.read_text())
    done, _ = type_tune("-o", file)
    assert done.exit_code == 0, done.output
    assert done.stdout == f"{file}\n"
    assert re.search(r"sigma_hit +0\.2 +0\.\d+", done.stderr)  # before, after
    assert given(file) == given(ROBOT) | learned.amcl.values
    for old, new in zip(ROBOT.read_text().splitlines(), file.read_text().splitlines(), strict=True):
        assert old == new or old.split(":")[0].strip() in learned.amcl.values
    assert list(findings_of_file(checked(file)[0])) == []


def test_a_link_stays_a_link_and_a_file_its_readers(type_tune, tmp_path: Path) -> None:
    file, link = tmp_path / "src.yaml", tmp_path / "install.yaml"
    file.write_text(ROBOT.read_text())
    file.chmod(0o640)
    link.symlink_to(file)
    done, _ = type_tune("-o", link)
    assert done.exit_code == 0, done.output
    assert link.is_symlink()
    assert file.stat().st_mode & 0o777 == 0o640
    assert given(file) != given(ROBOT)


def test_a_base_stays_as_it_is(learned: Tuning, type_tune, tmp_path: Path) -> None:
    file, new = tmp_path / "robot.yaml", tmp_path / "tuned.yaml"
    file.write_text(ROBOT.read_text())
    done, _ = type_tune("--nav2", file, "-o", new)
    assert done.exit_code == 0, done.output
    assert file.read_text() == ROBOT.read_text()
    assert given(new) == given(ROBOT) | learned.amcl.values
    done, before = type_tune("--nav2", file, "-o", new)
    assert (done.exit_code, "exists already" in done.stderr) == (1, True)
    done, after = type_tune("--nav2", file)
    assert done.stdout == new.read_text() + "\n"  # on stdout, whose last line ends
    assert after == before + 1


def test_a_new_file_has_amcl_alone(learned: Tuning, type_tune, tmp_path: Path) -> None:
    file = tmp_path / "nav2_params.yaml"
    done, _ = type_tune("-o", file)
    assert done.exit_code == 0, done.output
    assert YAML(typ="safe").load(file) == {"amcl": {"ros__parameters": learned.amcl.values}}
    assert file.read_text().startswith("# Learned by `mcl tune` from office (SHA-256 ")


def test_a_file_that_is_none_of_nav2s_is_told_before_the_work(type_tune, tmp_path: Path) -> None:
    file = tmp_path / "ours.yaml"
    file.write_text("z_hit: 0.5\n")
    for words, said in (
        (("-o", file), "exists already"),
        (("--nav2", file), "no parameters of ROS 2 in this file"),
        (("--nav2", tmp_path / "nowhere.yaml"), "cannot be read"),
    ):
        done, asked = type_tune(*words)
        assert (done.exit_code, said in done.stderr, asked) == (1, True, 0), done.stderr
    file.write_text("a:\n  amcl: {ros__parameters: {}}\nb:\n  amcl: {ros__parameters: {}}\n")
    done, asked = type_tune("-o", file)
    assert (done.exit_code, "several AMCL nodes" in done.stderr, asked) == (1, True, 0)
    assert file.read_text().count("amcl") == 2


def test_read_back_it_runs_as_the_learned_parameters_do(
    learned: Tuning, office: Log, type_tune, tmp_path: Path
) -> None:
    file = tmp_path / "nav2_params.yaml"
    file.write_text(ROBOT.read_text())
    type_tune("-o", file)
    meant = nav2.translate(nav2.Given("meant", given(ROBOT) | learned.amcl.values))
    start = learned.logs[0].ground_truth or office.ground_truth
    assert start is not None
    x, y, yaw = map(float, start.poses[0])
    own = {"init": "pose", "initial_pose": (x, y, yaw)}
    back, direct = load_config(file, **own), Config.model_validate({**meant.values, **own})
    assert back == direct
    log = office.part(slice(40))
    one, other = localize(log, back, seed=3), localize(log, direct, seed=3)
    np.testing.assert_array_equal(one.poses, other.poses)


def test_amcl_does_as_its_update_rule_says() -> None:
    way = [(0, 0, 0), (0.2, 0.2, 0), (0.26, 0, 0), (0.3, 0, 0.1), (0.3, 0, 0.21), (0.3, 0.26, 0.21)]
    odometry = np.array(way, float)
    assert amcl_updates(odometry, np.arange(6), 0.25, 0.2).tolist() == [0, 2, 4, 5]
    assert amcl_updates(odometry, np.array([1, 3, 5]), 0.25, 0.2).tolist() == [1, 5]


def test_alphas_have_the_size_of_the_errors() -> None:
    """Errors of a known variance are found again; and where one window in ten errs much, alpha3 covers it."""
    rng = np.random.default_rng(0)
    n = 100_000
    turned, driven = rng.uniform(0, 0.6, n), rng.uniform(0.02, 0.3, n)
    heading = rng.normal(0, np.sqrt(0.05 * turned + 2 * 0.01 * driven))
    along = rng.normal(0, np.sqrt(0.04 * driven + 0.03 * turned))
    found = moments(np.column_stack([heading, along, turned, driven]))
    np.testing.assert_allclose(found[:2], (0.05, 0.01), rtol=0.1)
    assert found[2] >= 0.03
    assert found[3] == pytest.approx(0.03, rel=0.3)
    slipping = np.where(rng.random(n) < 0.1, 0.8, along)
    assert moments(np.column_stack([heading, slipping, turned, driven]))[2] > 0.3


def test_wheels_that_do_what_no_model_expects_are_told_from_noisy_ones() -> None:
    rng = np.random.default_rng(1)
    n = 2000
    turned, driven = rng.uniform(0, 0.6, n), rng.uniform(0.1, 0.3, n)
    for noise in (0.002, 0.05):
        heading = rng.normal(0, np.sqrt(noise * turned))
        along = rng.normal(0, np.sqrt(noise * driven))
        assert surprise(np.column_stack([heading, along, turned, driven]), Config()) < 1.5
    backwards = np.where(rng.random(n) < 0.03, 0.9, along)  # told as forwards
    assert surprise(np.column_stack([heading, backwards, turned, driven]), Config()) > WILD


def test_every_value_has_its_reason(learned: Tuning) -> None:
    assert [reason.name for reason in learned.reasons] != []
    assert {reason.name for reason in learned.reasons} == set(PARAMETERS)
    for reason in learned.reasons:
        assert reason.value == getattr(learned.after, reason.name)
    told = {reason.name: reason for reason in learned.reasons}
    assert told["z_hit"].numbers["beams"] == learned.beams
    assert f"{learned.beams:,} beams at {learned.scans:,} scans" in told["z_hit"].text
    # The counts are those of the readings, and they explain the fit.
    for name in ("z_hit", "z_long", "z_short"):
        counted = told[name].numbers["ended_there"] / learned.beams
        assert abs(counted - getattr(learned.after, name)) < 0.25, name
    assert told["alpha1"].numbers["windows"] == len(learned.driven)
    amcls = {reason.name: reason for reason in learned.amcl.reasons}
    assert amcls.keys() == learned.amcl.values.keys()
    measured = amcls["alpha3"].numbers["measured"]
    assert learned.amcl.values["alpha3"] == pytest.approx(max(FREER * measured, 0.005), rel=0.01)


def test_explain_is_printed_and_in_the_json(learned: Tuning, type_tune, tmp_path: Path) -> None:
    file = tmp_path / "preset.yaml"
    done, _ = type_tune("-o", file, "--explain")
    lines = done.stdout.splitlines()
    assert {line.split()[0] for line in lines[:-1]} == set(PARAMETERS)
    value = f"{learned.after.sigma_hit:.4g}"
    assert re.search(rf"^sigma_hit +{value}: [\d,]+ beams that ended within 0.4 m", done.stdout, re.M)
    done, _ = type_tune("--explain")
    (tmp_path / "stdout.yaml").write_text(done.stdout)
    assert load_config(tmp_path / "stdout.yaml") == load_config(file)  # the reasons are its comments
    done, _ = type_tune("-o", tmp_path / "nav2.yaml", "--explain")
    assert re.search(r"^sigma_hit +0\.\d+: [\d,]+ of [\d,]+ beams at \d+ scans end within 0.5 m", done.stdout, re.M)
    done, _ = type_tune("--json")
    told = json.loads(done.stdout)
    assert [row["name"] for row in told["explain"]] == [reason.name for reason in learned.reasons]
    assert told["amcl"]["parameters"] == learned.amcl.values
    assert {row["name"] for row in told["amcl"]["explain"]} == set(learned.amcl.values)
