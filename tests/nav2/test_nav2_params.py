"""AMCL's parameter files are read as they are: same names, nav2's defaults, and a line for what has no meaning here."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from pipeline import nav2
from pipeline.cli import app
from pipeline.config import Config, dump_config, load_config
from pipeline.errors import MclError

WHOLE = """
amcl:
  ros__parameters:
    use_sim_time: True
    alpha1: 0.2
    alpha2: 0.2
    alpha3: 0.2
    alpha4: 0.2
    alpha5: 0.2
    base_frame_id: "base_footprint"
    beam_skip_distance: 0.5
    beam_skip_error_threshold: 0.9
    beam_skip_threshold: 0.3
    do_beamskip: false
    global_frame_id: "map"
    lambda_short: 0.1
    laser_likelihood_max_dist: 2.0
    laser_max_range: 100.0
    laser_min_range: -1.0
    laser_model_type: "likelihood_field"
    max_beams: 60
    max_particles: 2000
    min_particles: 500
    odom_frame_id: "odom"
    pf_err: 0.05
    pf_z: 0.99
    recovery_alpha_fast: 0.0
    recovery_alpha_slow: 0.0
    resample_interval: 1
    robot_model_type: "nav2_amcl::DifferentialMotionModel"
    save_pose_rate: 0.5
    sigma_hit: 0.2
    tf_broadcast: true
    transform_tolerance: 1.0
    update_min_a: 0.2
    update_min_d: 0.25
    z_hit: 0.5
    z_max: 0.05
    z_rand: 0.5
    z_short: 0.05
    scan_topic: scan
local_costmap:
  local_costmap:
    ros__parameters:
      plugins: ["voxel_layer", "inflation_layer"]
smoother_server:
  ros__parameters:
    simple_smoother:
      tolerance: 1.0e-10
"""
IGNORED = "use_sim_time, base_frame_id, global_frame_id, odom_frame_id, save_pose_rate, tf_broadcast, "
IGNORED += "transform_tolerance, scan_topic"


@pytest.fixture
def read(tmp_path: Path):
    """Loads a text as a file: the configuration, and what was remarked."""
    file = tmp_path / "nav2_params.yaml"

    def load(text: str, *settings: str, **flags: Any) -> tuple[Config, list[str]]:
        file.write_text(text)
        remarks: list[str] = []
        config = load_config(file, settings, remark=remarks.append, **flags)
        return config, [remark.removeprefix(f"{file}: ") for remark in remarks]

    return load


def amcl(**values: Any) -> str:
    return "amcl:\n  ros__parameters:\n" + "".join(f"    {name}: {value}\n" for name, value in values.items())


def test_nav2s_own_file_is_taken_as_it_is(read) -> None:
    config, remarks = read(WHOLE)
    assert remarks == [f"parameters of AMCL; ignored: {IGNORED}"]
    assert (config.alpha1, config.alpha4) == (0.2, 0.2)
    assert (config.kld_err, config.kld_z) == (0.05, 0.99)
    assert (config.max_particles, config.min_particles) == (2000, 500)
    assert (config.update_min_d, config.update_min_a) == (0.25, 0.2)
    assert (config.z_hit, config.z_short, config.z_max, config.z_rand) == (0.5, 0.05, 0.05, 0.5)
    assert config.sensor_model == "likelihood_field_cubes"
    assert (config.laser_min_range, config.laser_max_range) == (0.0, 100.0)
    assert (config.recovery, config.resample_ess) == ("none", 1.0)
    assert config.range_bias == 0.0


def test_what_a_file_leaves_out_has_amcls_default(read) -> None:
    assert read(amcl(use_sim_time="true"))[0] == read(WHOLE)[0]
    assert read("amcl:\n  ros__parameters:\n")[0] == read(WHOLE)[0]


def test_what_amcl_does_not_have_keeps_our_default(read) -> None:
    config, ours = read(WHOLE)[0], Config()
    for name in ("init", "adaptive", "resampler", "hindsight", "record_particles", "occupied_threshold", "ray_caster"):
        assert getattr(config, name) == getattr(ours, name)


def test_settings_and_flags_win_over_the_file(read) -> None:
    config, _ = read(WHOLE, "kld_err=0.1", "recovery=search", max_particles=7, min_particles=7)
    assert (config.kld_err, config.recovery, config.max_particles) == (0.1, "search", 7)


@pytest.mark.parametrize("name", [name for name, here in nav2.OURS.items() if name == here])
def test_the_same_name_is_the_same_number(read, name: str) -> None:
    value = {"do_beamskip": "true", "max_beams": 31, "max_particles": 901, "min_particles": 88}.get(name, 0.125)
    assert str(getattr(read(amcl(**{name: value}))[0], name)).lower() == str(value)


def test_pf_err_and_pf_z_have_other_names_here(read) -> None:
    config, _ = read(amcl(pf_err=0.01, pf_z=3.0))
    assert (config.kld_err, config.kld_z) == (0.01, 3.0)


@pytest.mark.parametrize(
    ("theirs", "ours", "beams"),
    [
        ("likelihood_field", "likelihood_field_cubes", 4.0),
        ("likelihood_field_prob", "likelihood_field_prob", None),
        ("beam", "beam", 4.0),
    ],
)
def test_a_model_weighs_as_amcls_does(read, theirs: str, ours: str, beams: float | None) -> None:
    config, remarks = read(amcl(laser_model_type=theirs))
    assert (config.sensor_model, config.independent_beams) == (ours, beams)
    assert len(remarks) == (theirs == "beam")


def test_the_beam_model_has_amcls_mixture(read) -> None:
    """AMCL: z_hit e^(-(d/sigma)^2/2) + z_rand / range_max, at d beyond the wall, and nothing else."""
    from pipeline.filter.beam_model import mixture_density

    config, _ = read(amcl(laser_model_type="beam", z_hit=0.7, sigma_hit=0.3, z_rand=0.2))
    for d in (0.0, 0.4, 3.0):
        expected = 0.7 * math.exp(-((d / 0.3) ** 2) / 2) + 0.2 / 10.0
        assert float(mixture_density(5.0 + d + 1e-9, 5.0, config, 10.0)) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("slow", "fast", "recovery"), [(0.0, 0.0, "none"), (0.001, 0.1, "augmented")])
def test_recovery_is_what_the_rates_ask_for(read, slow: float, fast: float, recovery: str) -> None:
    config, _ = read(amcl(recovery_alpha_slow=slow, recovery_alpha_fast=fast))
    assert (config.recovery, config.recovery_alpha_slow, config.recovery_alpha_fast) == (recovery, slow, fast)


def test_limits_of_minus_one_are_the_lasers_own(read) -> None:
    config, _ = read(amcl(laser_min_range=-1.0, laser_max_range=-1.0))
    assert (config.laser_min_range, config.laser_max_range) == (0.0, None)
    config, _ = read(amcl(laser_min_range=0.3, laser_max_range=12.0))
    assert (config.laser_min_range, config.laser_max_range) == (0.3, 12.0)


POSE = "\n    initial_pose:\n      x: 1.5\n      y: -2\n      yaw: 0.5\n      z: 0.1\n"


def test_a_pose_is_begun_at_if_the_file_sets_it(read) -> None:
    config, remarks = read(amcl(set_initial_pose="true") + POSE)
    assert (config.init, config.initial_pose) == ("pose", (1.5, -2.0, 0.5))
    assert remarks == ["parameters of AMCL; ignored: initial_pose.z"]
    config, _ = read(amcl(set_initial_pose="true", **{"initial_pose.x": 3.0}))
    assert config.initial_pose == (3.0, 0.0, 0.0)


def test_a_pose_that_is_not_set_waits_for_init_pose(read) -> None:
    config, _ = read(amcl(max_beams=30) + POSE)
    assert (config.init, config.initial_pose) == ("exhaustive", (1.5, -2.0, 0.5))
    assert read(amcl(max_beams=30) + POSE, init="pose")[0].init == "pose"


def test_resampling_at_every_other_update(read) -> None:
    config, remarks = read(amcl(resample_interval=2))
    assert (config.resample_interval, config.resample_ess) == (2, 1.0)
    assert not any("resample_interval" in remark for remark in remarks)


@pytest.mark.parametrize("name", ["differential", "nav2_amcl::DifferentialMotionModel"])
def test_a_robot_that_drives_as_most_do_has_our_odometry_model(read, name: str) -> None:
    config, remarks = read(amcl(robot_model_type=name))
    assert (config.motion_model, remarks) == ("odometry", [])


@pytest.mark.parametrize("name", ["omnidirectional", "nav2_amcl::OmniMotionModel"])
def test_a_robot_that_drives_sideways_has_its_own_model(read, name: str) -> None:
    config, remarks = read(amcl(robot_model_type=name, alpha5=0.07))
    assert (config.motion_model, config.alpha5, remarks) == ("omnidirectional", 0.07, [])


def test_an_unknown_drive_is_remarked_on(read) -> None:
    config, (remark,) = read(amcl(robot_model_type="mine::Walks"))
    assert config.motion_model == "odometry"
    assert "mine::Walks is unknown" in remark


def test_fewer_particles_at_most_than_at_least_are_made_as_many(read) -> None:
    config, _ = read(amcl(min_particles=3000))
    assert (config.min_particles, config.max_particles) == (3000, 3000)


def test_what_amcl_does_not_know_is_named_apart(read) -> None:
    (remark,) = read(amcl(tf_broadcast="true", zhit=0.5, kld_err=0.1))[1]
    assert remark == "parameters of AMCL; ignored: tf_broadcast, and what AMCL does not know: zhit, kld_err"


def test_nodes_may_stand_in_namespaces_and_every_node_may_be_given_parameters(read) -> None:
    nested = "robot1:\n  amcl:\n    ros__parameters: {max_beams: 17}\n  other:\n    ros__parameters: {max_beams: 3}\n"
    assert read(nested)[0].max_beams == 17
    assert read("/robot1/amcl:\n  ros__parameters: {max_beams: 17}\n")[0].max_beams == 17
    assert read("ros__parameters: {max_beams: 17}\n")[0].max_beams == 17
    config, remarks = read("/**:\n  ros__parameters: {max_beams: 17, pf_err: 0.2, rate: 3}\n" + amcl(max_beams=18))
    assert (config.max_beams, config.kld_err, remarks) == (18, 0.2, [])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (amcl(pf_err=-1), r"nav2_params\.yaml: pf_err: .*number above 0, got -1"),
        (amcl(alpha1="lots"), r"nav2_params\.yaml: alpha1: .*'lots'"),
        (amcl(sigma_hit="wide", laser_model_type="beam"), r"sigma_hit: expected a number, got 'wide'"),
        (amcl(laser_model_type="sonar"), r"laser_model_type: expected one of beam, .*'sonar'"),
        (amcl(set_initial_pose="maybe"), r"set_initial_pose: expected true or false"),
        ("map_server:\n  ros__parameters: {}\n", r"no parameters of 'amcl' in this ROS file: it has map_server"),
        (
            "a:\n  amcl: {ros__parameters: {}}\nb:\n  amcl: {ros__parameters: {}}\n",
            r"several AMCL nodes: a/amcl, b/amcl",
        ),
    ],
)
def test_what_is_wrong_is_said_in_the_files_own_words(read, text: str, said: str) -> None:
    with pytest.raises(MclError, match=said):
        read(text)


def test_amcls_name_typed_as_a_setting_leads_to_ours() -> None:
    with pytest.raises(MclError, match=r"unknown parameter 'pf_err' \(did you mean 'kld_err'\?\)"):
        load_config(None, ["pf_err=0.1"])


def test_mcl_config_shows_what_a_file_amounts_to(tmp_path: Path, read) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text(WHOLE)
    done = CliRunner().invoke(app, ["config", str(file)])
    assert done.exit_code == 0
    assert done.stderr.splitlines() == [f"note: {file}: parameters of AMCL; ignored: {IGNORED}"]
    (tmp_path / "again.yaml").write_text(done.stdout)
    assert load_config(tmp_path / "again.yaml") == read(WHOLE)[0]
    assert dump_config(read(WHOLE)[0])
