"""Every parameter: bounds, precedence, presets, and what a mistake is told."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from pipeline.config import Config, check_name, dump_config, load_config, preset_names
from pipeline.errors import MclError


def told(error: pytest.ExceptionInfo[MclError]) -> str:
    said = str(error.value)
    assert "\n" not in said
    return said


def test_every_parameter_is_described_by_a_sentence():
    for name, field in Config.model_fields.items():
        assert field.description, name
        assert field.description.endswith("."), name


def test_defaults_are_what_nothing_gives():
    assert load_config() == Config()


def test_a_flag_wins_over_set_over_file_over_default(tmp_path: Path):
    file = tmp_path / "mine.yaml"
    file.write_text("max_beams: 10\nalpha1: 0.1\nalpha2: 0.1\n")
    config = load_config(file, ["alpha1=0.2", "alpha2=0.2"], alpha2=0.3, alpha3=None)
    assert (config.max_beams, config.alpha1, config.alpha2) == (10, 0.2, 0.3)
    assert config.alpha3 == Config().alpha3


def test_the_last_of_two_settings_wins():
    assert load_config(None, ["max_beams=5", "max_beams=6"]).max_beams == 6


def test_settings_are_yaml():
    config = load_config(None, ["init=pose", "initial_pose=[1, 2.5, 1e-3]", "laser_max_range=null", "alpha1 = 1e-3"])
    assert config.initial_pose == (1.0, 2.5, 0.001)
    assert config.laser_max_range is None
    assert config.alpha1 == 0.001


def test_an_empty_file_changes_nothing(tmp_path: Path):
    file = tmp_path / "empty.yaml"
    file.write_text("# nothing yet\n")
    assert load_config(file) == Config()


@pytest.mark.parametrize("name", preset_names())
def test_presets_load_and_come_back(name: str, tmp_path: Path):
    config = load_config(name)
    assert config != Config()
    file = tmp_path / "again.yaml"
    file.write_text(dump_config(config))
    assert load_config(file) == config


def test_the_course_preset_keeps_the_proportions_of_the_report():
    """Its tables count centimetres: densities grow by 100 in metres, and so must the mass beside them."""
    course = load_config("course")
    assert course.z_max / course.z_hit == pytest.approx(100 * 0.01 / 12)
    assert course.z_rand / course.z_hit == pytest.approx(8000 / 12)
    assert course.sigma_hit == 2.0
    assert course.lambda_short == pytest.approx(0.002 * 100)
    assert course.alpha2 == pytest.approx(0.0001 * 100**2)
    assert course.alpha4 == pytest.approx(0.01 / 100**2)


numbers = st.floats(0.0, 1e6, allow_nan=False)


@given(
    alpha1=numbers,
    sigma_hit=st.floats(1e-9, 1e6),
    max_beams=st.integers(1, 10_000),
    init=st.just("pose"),
    initial_pose=st.tuples(*[st.floats(-1e4, 1e4)] * 3),
    initial_pose_std=st.tuples(numbers, numbers, numbers),
    laser_max_range=st.none() | st.floats(1e-3, 1e3),
)
def test_what_is_dumped_is_read_back_to_the_last_digit(tmp_path_factory: pytest.TempPathFactory, **values: Any):
    config = Config(**values)
    file = tmp_path_factory.getbasetemp() / "dumped.yaml"
    file.write_text(dump_config(config))
    assert load_config(file) == config


def test_a_dump_has_the_parameters_in_the_order_that_tells_the_story():
    names = [line.partition(":")[0] for line in dump_config(Config()).splitlines() if re.match(r"\w+:", line)]
    assert names == [name for name in Config.model_fields if name != "own"]


def test_a_config_cannot_be_changed():
    with pytest.raises(ValidationError):
        Config().alpha1 = 1.0  # type: ignore[misc]


def test_a_number_that_nobody_means_is_named() -> None:
    with pytest.raises(MclError, match=r"sigma_hit is 1e\+300, which no parameter is"):
        load_config(None, ["sigma_hit=1e300"])


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (["max_particle=5"], r"unknown parameter 'max_particle' \(did you mean 'max_particles'\?\)"),
        (["zhit=1"], r"did you mean 'z_hit'"),
        (["qqq=1"], r"^unknown parameter 'qqq' \(mcl config lists all\)$"),
        (["sensr_model.x=1"], r"did you mean 'sensor_model\.x'"),
        (["max_particles=0"], r"^max_particles: expected a whole number from 1 to 20,000,000, got 0$"),
        (["max_beams=1.5"], r"^max_beams: expected a whole number of at least 1, got 1\.5$"),
        (["z_hit=-1"], r"^z_hit: .*got -1$"),
        (["sigma_hit=0"], r"^sigma_hit: expected a number above 0 \(m\), got 0$"),
        (["alpha1=.nan"], r"^alpha1: expected a number of at least 0 \(rad\^2/rad\^2\), got nan"),
        (["alpha1=.inf"], r"^alpha1: .*got inf"),
        (["do_beamskip=perhaps"], r"^do_beamskip: expected true or false, got 'perhaps'$"),
        (["without=gaps"], r"^without: expected a list in brackets, like \[gaps\]"),
        (["occupied_threshold=1.1"], r"^occupied_threshold: expected a number from 0 to 1, got 1.1$"),
        (["ray_caster=magic"], r"^ray_caster: expected one of table, dda, bresenham, got 'magic'$"),
        (["init=pose"], r"initial_pose"),
        (["init=pose", "initial_pose=[1, 2]"], r"^initial_pose"),
        (["alpha1"], r"--set 'alpha1': expected key=value"),
        (["alpha1=[1"], r"--set alpha1=\[1: the value is not YAML"),
        (["alpha1="], r"^alpha1: "),
    ],
)
def test_a_wrong_setting_is_named(settings: list[str], said: str):
    with pytest.raises(MclError) as error:
        load_config(None, settings)
    assert re.search(said, told(error))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("max_particle: 5\n", r"wrong\.yaml: unknown parameter 'max_particle'"),
        ("max_beams: many\n", r"wrong\.yaml: max_beams: .*'many'"),
        ("init: map\nmax_beams: [1\n", r"wrong\.yaml:3: "),
        ("- 1\n- 2\n", r"wrong\.yaml: expected a mapping"),
        ("just words\n", r"wrong\.yaml: expected a mapping"),
    ],
)
def test_a_wrong_file_is_named(tmp_path: Path, text: str, said: str):
    file = tmp_path / "wrong.yaml"
    file.write_text(text)
    with pytest.raises(MclError) as error:
        load_config(file)
    assert re.search(said, told(error))


def test_a_missing_file_lists_the_presets(tmp_path: Path):
    with pytest.raises(MclError) as error:
        load_config(tmp_path / "nosuch.yaml")
    assert "nosuch.yaml: no such config file or preset (presets: " in told(error)


def test_a_parameter_of_an_earlier_version_is_one_line_and_not_read(tmp_path: Path):
    old = tmp_path / "config.yaml"
    old.write_text("max_beams: 90\nslip: 0.3\n")
    said: list[str] = []
    assert load_config(old, remark=said.append) == Config(max_beams=90)
    (line,) = said
    assert line.startswith(f"{old}: the parameter 'slip' is gone, and not read: ")
    assert "odometry=both" in line
    assert load_config(None, ["slip=0"], remark=said.append) == Config()
    assert said[1].startswith("--set: the parameter 'slip' is gone")


def test_what_is_gone_cannot_be_varied():
    with pytest.raises(MclError, match=r"the parameter 'slip' is gone.*odometry=both"):
        check_name("slip")
