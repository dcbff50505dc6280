"""`mcl config --check`: what is wrong with a file of AMCL's parameters, by itself and beside a log."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from pipeline import nav2
from pipeline.check import amcl_log
from pipeline.check.amcl_file import checked, findings_of_file
from pipeline.check.findings import Finding
from pipeline.cli import app
from pipeline.config import Config
from pipeline.logs.messages import Log

ROBOT = Path(__file__).parents[1] / "nav2" / "robot.yaml"


def amcl(values: dict[str, Any] | str) -> str:
    lines = values if isinstance(values, str) else "".join(f"    {name}: {value}\n" for name, value in values.items())
    return f"amcl:\n  ros__parameters:\n{lines}"


@pytest.fixture
def look(tmp_path: Path):
    def at(values: dict[str, Any] | str) -> list[Finding]:
        file = tmp_path / "nav2_params.yaml"
        file.write_text(amcl(values))
        given, found = checked(file)
        return [*found, *findings_of_file(given)]

    return at


def run(*words: object) -> Result:
    return CliRunner().invoke(app, ["config", "--check", *map(str, words)])


def test_a_sound_file_has_nothing_to_find() -> None:
    done = run(ROBOT)
    assert (done.exit_code, done.stdout.splitlines()) == (0, [str(ROBOT), "findings: nothing was found"])


def test_nav2s_defaults_are_sound(look) -> None:
    fresh = nav2.fresh({name: value for name, value in nav2.DEFAULTS.items() if not name.startswith("initial_pose")})
    assert look(fresh.partition("ros__parameters:\n")[2]) == []


@pytest.mark.parametrize(
    ("values", "grade", "about", "said", "do"),
    [
        ({"alpha1": 1}, "broken", "alpha1", r"line 3: alpha1 is 1, of type integer; .*refuses", r"Write 1\.0\."),
        ({"max_beams": 60.0}, "broken", "max_beams", "is 60.0, of type double; .*an integer", r"Write 60\."),
        ({"max_beams": 60.5}, "broken", "max_beams", "of type double", "Write an integer"),
        ({"alpha1": '"0.2"'}, "broken", "alpha1", "is '0.2', of type string", "Write a double"),
        ({"tf_broadcast": 1}, "broken", "tf_broadcast", "of type integer", "Write true or false"),
        ({"tf_broadcast": '"true"'}, "broken", "tf_broadcast", "of type string", "Write true or false"),
        ({"scan_topic": "yes"}, "broken", "scan_topic", "is true, of type bool", "Write a text"),
        ({"sigma_hit": "[0.2]"}, "broken", "sigma_hit", "of type list", "Write a double"),
        ({"sigma_hit": ""}, "broken", "sigma_hit", "is nothing, of type nothing", "Write a double"),
        ({"alpha1": -0.1}, "broken", "alpha1", "is -0.1; expected at least 0", "default is 0.2"),
        ({"sigma_hit": 0.0}, "broken", "sigma_hit", "expected more than 0", "default is 0.2"),
        ({"sigma_hit": ".nan"}, "broken", "sigma_hit", "is nan; expected more than 0", "default is 0.2"),
        ({"max_beams": 1}, "broken", "max_beams", "expected at least 2", "default is 60"),
        ({"z_hit": 1.5}, "broken", "z_hit", "expected at least 0 and at most 1", "default"),
        ({"laser_min_range": -2.0}, "broken", "laser_min_range", "at least 0, or -1", "default is -1.0"),
        ({"laser_model_type": "beams"}, "broken", "laser_model_type", "is 'beams'; expected one of beam", "'likeli"),
        ({"robot_model_type": '"nav2_amcl::Diff"'}, "broken", "robot_model_type", "expected one of nav2_amcl", "D"),
        ({"sigma_hitt": 0.2}, "doubtful", "sigma_hitt", "no parameter sigma_hitt", r"Did you mean 'sigma_hit'\?"),
        ({"kld_err": 0.2}, "doubtful", "kld_err", "no parameter kld_err", "Take it out|Did you mean"),
        ({"min_particles": 3000}, "broken", "min_particles", r"\(3000\) is more than max_particles \(2000\)", "Raise"),
        ({"max_particles": 50}, "broken", "max_particles", r"line 3: min_particles \(500\) is more", "lower"),
        ({"laser_min_range": 2.0, "laser_max_range": 1.0}, "broken", "laser_min_range", r"\(2 m\).*\(1 m\)", "below"),
        ({"laser_min_range": 2.0, "laser_max_range": 2.0}, "broken", "laser_min_range", "no reading counts", "below"),
        ({"z_hit": 0.95}, "doubtful", "z_hit", r"z_hit \+ z_rand is 1.45, and AMCL normalises nothing", "by 1.45"),
        ({"laser_model_type": "beam", "z_max": 0.9}, "doubtful", "z_max", r"z_hit \+ z_short \+ z_max", "Divide"),
        ({"z_hit": 0.0, "z_rand": 0.0}, "broken", "z_hit", "all poses weigh the same", "add up to 1"),
        ({"do_beamskip": "true"}, "doubtful", "do_beamskip", "no effect with laser_model_type likelihood", "Only"),
        ({"sigma_hit": 3.0}, "broken", "sigma_hit", "not below laser_likelihood_max_dist", "Lower"),
        ({"update_min_d": 1.5}, "doubtful", "update_min_d", "is 1.5 m: so far", "default is 0.25 m"),
        ({"update_min_a": 2.0}, "doubtful", "update_min_a", "is 2 rad: so far", "default is 0.2 rad"),
        ({"update_min_a": 0.0, "update_min_d": 0.0}, "doubtful", "update_min_d", "stands still", "Set both"),
        ({"alpha3": 90.0}, "broken", "alpha3", r"spread by 2.4 m in one update", "mcl tune"),
        ({"recovery_alpha_slow": 0.001}, "doubtful", "recovery_alpha_slow", "one average stays", "both"),
        (
            {"recovery_alpha_slow": 0.1, "recovery_alpha_fast": 0.001},
            "broken", "recovery_alpha_fast", "not below", "slow rate is the smaller",
        ),
        ({"set_initial_pose": "true"}, "doubtful", "set_initial_pose", "AMCL starts at 0, 0, 0", "Give initial_pose"),
        ({"initial_pose.x": 1.0}, "doubtful", "initial_pose.x", "does not use it", "Set set_initial_pose to true"),
        ({"odom_frame_id": "map"}, "broken", "odom_frame_id", "are both 'map'", "its own name"),
        ({"base_frame_id": "/odom"}, "broken", "base_frame_id", "are both 'odom'", "its own name"),
        ({"tf_broadcast": "false"}, "noted", "tf_broadcast", "nobody publishes", "Nothing"),
    ],
)  # fmt: skip
def test_one_thing_that_is_wrong_is_found_and_nothing_else(
    look, values: dict[str, Any], grade: str, about: str, said: str, do: str
) -> None:
    (finding,) = look(values)
    assert (finding.grade, finding.about) == (grade, about)
    assert re.search(said, finding.text), finding.text
    assert re.search(do, finding.do), finding.do


@pytest.mark.parametrize("name", nav2.PARAMETERS)
def test_every_parameter_of_a_wrong_type_is_refused(look, name: str) -> None:
    wrong = {"double": "1", "integer": "1.5", "bool": "3", "string": "1.5"}[nav2.PARAMETERS[name].kind]
    found = [finding for finding in look({name: wrong}) if finding.about == name]
    assert [finding.grade for finding in found if "nav2 refuses" in finding.text] == ["broken"]


def test_what_is_plainly_meant_counts_for_the_rest(look) -> None:
    """A double where an integer belongs is one finding; the number that was meant takes part in the others."""
    found = look({"min_particles": 900, "max_particles": 500.0})
    assert [finding.about for finding in found] == ["max_particles", "min_particles"]
    assert "(900) is more than max_particles (500)" in found[1].text


VALUES = st.one_of(st.booleans(), st.integers(-9, 9999), st.floats(-9, 99), st.sampled_from(["beam", "map", "x"]))


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(values=st.dictionaries(st.sampled_from(sorted(nav2.PARAMETERS)), VALUES))
def test_whatever_stands_there_is_a_finding_or_sound(tmp_path_factory: Any, values: dict[str, Any]) -> None:
    file = tmp_path_factory.mktemp("any") / "p.yaml"
    file.write_text(amcl({k: str(v).lower() if isinstance(v, bool) else repr(v) for k, v in values.items()}))
    given_there, _ = checked(file)
    found = list(findings_of_file(given_there))
    wrong = {
        name
        for name, value in values.items()
        if nav2.PARAMETERS[name].wrong_type(value) or nav2.PARAMETERS[name].wrong_value(value)
    }
    assert wrong <= {finding.about for finding in found if finding.grade == "broken"}


def test_broken_is_exit_code_1_and_doubtful_is_not(tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_text(amcl({"update_min_d": 1.5}))
    assert run(file).exit_code == 0
    file.write_text(amcl({"update_min_d": 1.5, "alpha1": 1, "tf_broadcast": "false"}))
    done = run(file)
    assert done.exit_code == 1
    lines = done.stdout.splitlines()
    assert lines[:2] == [str(file), "findings: 1 broken, 1 doubtful, 1 noted"]
    assert [line.split()[0] for line in lines[2::2]] == ["broken", "doubtful", "noted"]
    as_json = run(file, "--json")
    assert as_json.exit_code == 1
    told = json.loads(as_json.stdout)
    assert told["file"] == str(file)
    assert [finding["about"] for finding in told["findings"]] == ["alpha1", "update_min_d", "tf_broadcast"]


def test_ros_1_is_checked_in_its_own_words(tmp_path: Path) -> None:
    file = tmp_path / "amcl.yaml"
    file.write_text("odom_alpha1: -1\nlaser_z_hitt: 0.5\nlaser_max_beams: 30\nmin_particles: 9000\n")
    done = run(file)
    assert done.exit_code == 1
    assert "odom_alpha1 is -1.0; expected at least 0" in done.stdout
    assert "Did you mean 'laser_z_hit'?" in done.stdout
    assert "min_particles (9000) is more than max_particles (5000)" in done.stdout
    launch = tmp_path / "amcl.launch"
    launch.write_text(
        '<launch><node pkg="amcl" name="amcl"><param name="laser_sigma_hit" value="0"/>\n'
        '<param name="odom_model_type" value="diff-corrected"/><rosparam file="x.yaml"/></node></launch>'
    )
    done = run(launch)
    assert "laser_sigma_hit is 0.0; expected more than 0" in done.stdout
    assert "noted     reading: " in done.stdout


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "--check needs a file"),
        (("nowhere.yaml",), "nowhere.yaml: cannot be read"),
        ((ROBOT, "--map", "map.yaml"), "--map goes with a log"),
    ],
)
def test_what_cannot_be_checked_is_one_line(words: tuple[object, ...], said: str) -> None:
    done = run(*words)
    assert done.exit_code == 1
    assert said in done.stderr


def test_a_file_of_something_else_is_told(tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    for text, said in (("a: 1\n", "no parameters of AMCL"), ("b: {ros__parameters: {}}\n", "no parameters of 'amcl'")):
        file.write_text(text)
        done = run(file)
        assert (done.exit_code, said in done.stderr) == (1, True), done.stderr


def test_options_of_the_check_go_with_it(tmp_path: Path) -> None:
    for words in (("course", "log.mcap"), ("--json",), ("--map", "m.yaml")):
        done = CliRunner().invoke(app, ["config", *words])
        assert (done.exit_code, "goes with --check" in done.stderr) == (1, True)


def beside(log: Log, tmp_path: Path, values: dict[str, Any], config: Config) -> dict[str, Finding]:
    file = tmp_path / "p.yaml"
    file.write_text(amcl(values))
    return {finding.about: finding for finding in amcl_log.findings_of_log(checked(file)[0], log, config)}


def started(log: Log) -> Config:
    assert log.ground_truth is not None
    x, y, yaw = log.ground_truth.poses[0]
    few = {"max_particles": 1000, "min_particles": 500, "recovery": "none"}
    return Config(init="pose", initial_pose=(float(x), float(y), float(yaw)), **few)  # type: ignore[arg-type]


def test_values_far_from_what_a_log_shows_are_found(office: Log, tmp_path: Path) -> None:
    log = dataclasses.replace(office.part(slice(160)), ground_truth=office.ground_truth)
    far = {"alpha3": 3.0, "sigma_hit": 0.9, "laser_max_range": 1.5}
    found = beside(log, tmp_path, far, started(office))
    assert {"alpha3", "sigma_hit", "laser_max_range"} <= found.keys()
    assert all(found[name].grade == "doubtful" for name in far)
    assert re.search(r"alpha3 is 3: the deviation that it means is \d+ times what this log shows", found["alpha3"].text)
    # What it advises is not far any more.
    near = {name: re.search(r"Write (\S+),", found[name].do)[1] for name in ("alpha3", "sigma_hit")}  # type: ignore[index]
    assert not {"alpha3", "sigma_hit"} & beside(log, tmp_path, near, started(office)).keys()


def test_without_a_map_ranges_and_names_are_compared(office: Log, tmp_path: Path) -> None:
    metadata = {"reader": {"scan_topic": "/front/scan", "frames": "odom -> base_link -> laser"}}
    log = dataclasses.replace(office, grid=None, metadata=metadata)
    found = beside(log, tmp_path, {"scan_topic": "scan", "odom_frame_id": "odom", "laser_max_range": 1.5}, Config())
    assert found.keys() == {"scan_topic", "base_frame_id", "laser_max_range", "map"}
    assert (found["scan_topic"].grade, found["base_frame_id"].grade) == ("doubtful", "doubtful")
    assert "this log has 'front/scan'" in found["scan_topic"].text


def test_a_log_in_which_nobody_is_found_is_told(office: Log, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    log = dataclasses.replace(office.part(slice(30)), ranges=rng.uniform(1, 9, (30, office.laser.beams)).astype("f4"))
    found = beside(log, tmp_path, {}, started(office))
    assert "not compared" in found["reading"].text
