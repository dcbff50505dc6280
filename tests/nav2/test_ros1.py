"""AMCL's parameters of ROS 1, from YAML and from launch files, are read as nav2's are; hostile XML does nothing."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from pipeline import nav2
from pipeline.config import Config, load_config
from pipeline.errors import MclError
from pipeline.nav2 import ros1

TURTLEBOT = """<?xml version="1.0"?>
<launch>
  <!-- as it lies in many a robot's package -->
  <arg name="scan_topic" default="scan"/>
  <arg name="initial_pose_x" default="1.5"/>
  <arg name="beams" value="40"/>
  <arg name="slow" default="false"/>
  <node pkg="map_server" type="map_server" name="map_server" args="$(find robot)/map.yaml"/>
  <group ns="robot" unless="$(arg slow)">
    <node pkg="amcl" type="amcl" name="amcl" output="screen">
      <param name="odom_model_type" value="diff-corrected"/>
      <param name="odom_alpha1" value="0.05"/>
      <param name="laser_max_beams" value="$(arg beams)"/>
      <param name="laser_z_hit" value="0.9" type="double"/>
      <param name="min_particles" value="300"/>
      <param name="use_map_topic" value="true"/>
      <param name="initial_pose_x" value="$(arg initial_pose_x)"/>
      <param name="initial_pose_a" value="0.5"/>
      <param name="initial_cov_xx" value="0.04"/>
      <param name="kld_err" value="0.02" unless="$(arg slow)"/>
      <param name="kld_z" value="0.5" if="$(arg slow)"/>
      <rosparam>
        laser_sigma_hit: 0.1
        laser_model_type: likelihood_field_prob
      </rosparam>
      <rosparam subst_value="true">{max_particles: $(arg beams)00}</rosparam>
      <remap from="scan" to="$(arg scan_topic)"/>
    </node>
  </group>
</launch>
"""


@pytest.fixture
def read(tmp_path: Path):
    def load(text: str, name: str = "amcl.launch") -> tuple[Config, list[str]]:
        file = tmp_path / name
        file.write_text(text)
        remarks: list[str] = []
        config = load_config(file, remark=remarks.append)
        return config, [remark.replace(str(file), "FILE") for remark in remarks]

    return load


def launch(inner: str, node: str = 'pkg="amcl" type="amcl" name="amcl"') -> str:
    return f"<launch>\n<node {node}>\n{inner}\n</node>\n</launch>\n"


def test_a_launch_file_is_read_with_the_defaults_of_its_arguments(read) -> None:
    config, remarks = read(TURTLEBOT)
    assert (config.alpha1, config.alpha2) == (0.05, 0.2)
    assert (config.max_beams, config.z_hit, config.sigma_hit) == (40, 0.9, 0.1)
    assert (config.min_particles, config.max_particles) == (300, 4000)
    assert (config.kld_err, config.kld_z) == (0.02, 0.99)
    assert config.sensor_model == "likelihood_field_prob"
    assert (config.init, config.initial_pose) == ("pose", (1.5, 0.0, 0.5))
    assert config.initial_pose_std == pytest.approx((0.2, 0.5, math.pi / 12))
    assert remarks == ["FILE: parameters of AMCL; ignored: scan_topic, use_map_topic"]


def test_what_is_left_out_has_the_default_of_ros_1(read) -> None:
    config, _ = read(launch('<param name="odom_model_type" value="diff-corrected"/>'))
    assert (config.min_particles, config.max_particles) == (100, 5000)
    assert (config.kld_err, config.max_beams, config.z_hit, config.z_rand) == (0.01, 30, 0.95, 0.05)
    assert (config.update_min_d, config.resample_interval) == (0.2, 2)
    assert config.update_min_a == pytest.approx(math.pi / 6)
    assert (config.alpha1, config.laser_max_range) == (0.2, None)


def test_yaml_of_ros_1_is_known_by_its_names(read) -> None:
    text = "odom_alpha1: 0.1\nodom_model_type: diff-corrected\nlaser_max_range: 12\nmin_particles: 200\n"
    for indented in (text, "amcl:\n" + "".join(f"  {line}\n" for line in text.splitlines())):
        config, remarks = read(indented, "amcl.yaml")
        assert (config.alpha1, config.laser_max_range, config.min_particles) == (0.1, 12.0, 200)
        assert config.sensor_model == "likelihood_field_cubes"
        assert remarks == []


def test_a_preset_of_ours_is_not_taken_for_ros_1(read) -> None:
    assert read("kld_err: 0.1\nmin_particles: 7\nlaser_max_range: 9.0\n", "ours.yaml")[0].z_hit == Config().z_hit


@pytest.mark.parametrize("name", [n for n in ros1.NAMES if n in nav2.OURS and not n.startswith("alpha")])
def test_every_name_of_ros_1_reaches_its_parameter(read, name: str) -> None:
    default = nav2.PARAMETERS[name].default
    value: Any = True if isinstance(default, bool) else 600 if isinstance(default, int) else 0.125
    text = f"{ros1.NAMES[name]}: {str(value).lower()}\ngui_publish_rate: 10\nodom_model_type: diff-corrected\n"
    assert getattr(read(text, "amcl.yaml")[0], nav2.OURS[name]) == value


def test_the_old_model_means_the_same_step(read) -> None:
    """diff draws a deviation of alpha2 d^2; diff-corrected, like nav2 and us, a variance of alpha2 d^2."""
    config, remarks = read("odom_alpha2: 0.3\nodom_alpha1: 0.4\nodom_model_type: diff\nupdate_min_d: 0.25\n", "a.yaml")
    d, a = 0.25, math.pi / 6
    assert math.sqrt(config.alpha2 * d * d) == pytest.approx(0.3 * d * d)
    assert math.sqrt(config.alpha1 * a * a) == pytest.approx(0.4 * a * a)
    assert any("diff-corrected" in remark for remark in remarks)


def test_a_robot_that_drives_sideways_has_its_own_model(read) -> None:
    config, remarks = read("odom_model_type: omni-corrected\nodom_alpha5: 0.03\n", "a.yaml")
    assert (config.motion_model, config.alpha5, remarks) == ("omnidirectional", 0.03, [])


def test_the_xml_of_ros_2_has_nav2s_names(read) -> None:
    inner = '<param name="alpha1" value="0.03"/><param name="max_beams" value="$(var beams)"/>'
    text = launch(inner, 'pkg="nav2_amcl" exec="amcl" name="amcl"')
    config, _ = read(text.replace("<launch>", '<launch><arg name="beams" default="77"/>'))
    assert (config.alpha1, config.max_beams, config.max_particles) == (0.03, 77, 2000)


@pytest.mark.parametrize(
    ("inner", "said"),
    [
        ('<param name="laser_z_hit" value="$(env Z)"/>', "FILE:3: laser_z_hit is not taken"),
        ('<param name="laser_z_hit" value="$(arg nobody)"/>', "FILE:3: laser_z_hit is not taken"),
        ('<param name="laser_z_hit" value="$(eval 1/0)"/>', "FILE:3: laser_z_hit is not taken"),
        ('<param name="laser_z_hit" command="rm -rf /"/>', "FILE:3: laser_z_hit is not taken"),
        ('<param name="laser_z_hit" textfile="/etc/passwd"/>', "FILE:3: laser_z_hit is not taken"),
        ('<rosparam file="/etc/passwd" command="load"/>', "FILE:3: the parameters in /etc/passwd are not read"),
        ('<rosparam subst_value="true">{laser_z_hit: $(find x)}</rosparam>', "FILE:3: <rosparam> is not taken"),
        ('<param name="laser_z_hit" value="0.1" if="$(env Z)"/>', "FILE:3: <param if=...> is left out"),
    ],
)
def test_what_depends_on_something_else_is_told_and_not_taken(read, inner: str, said: str) -> None:
    config, remarks = read(launch(inner))
    assert config.z_hit == ros1.DEFAULTS["z_hit"]
    assert any(remark.startswith(said) for remark in remarks), remarks


BOMB = '<!DOCTYPE l [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;">]>'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (BOMB + launch('<param name="laser_z_hit" value="&c;"/>'), "launch:1: a launch file has no document type"),
        (
            '<!DOCTYPE l [<!ENTITY x SYSTEM "file:///etc/passwd">]>' + launch('<param name="a" value="&x;"/>'),
            "amcl.launch:1: a launch file has no document type",
        ),
        ('<!DOCTYPE launch SYSTEM "http://x/y.dtd">' + launch(""), "no document type"),
        (launch('<param name="a" value="&x;"/>'), "amcl.launch:3: not XML: undefined entity"),
        ("<launch>" + "<group>" * 100_000, "nested too deeply"),
        ("<launch>" + "<a/>" * 300_000 + "</launch>", "too large"),
        ("<launch><node", "not XML: unclosed token"),
        ("<html><body/></html>", "expected a launch file, got XML of <html>"),
        ("<launch/>", "no node of AMCL in this launch file"),
        ('<launch><include file="b.launch"/></launch>', "the files that it includes are not read"),
        (launch("") [:-10] + '<node pkg="amcl" type="amcl" name="b"/></launch>', "several nodes of AMCL"),
        (launch('<param name="laser_z_hit" value="much" type="double"/>'), "launch:3: expected double, got 'much'"),
        (launch("<rosparam>[</rosparam>"), "amcl.launch:3: what stands there is not YAML"),
        (launch('<param name="laser_z_hit" value="-1.0"/>'), "laser_z_hit: .*number of at least 0, got -1.0"),
    ],
)  # fmt: skip
def test_a_wrong_or_hostile_file_gets_one_line(read, text: str, said: str) -> None:
    with pytest.raises(MclError, match=said):
        read(text)


def test_an_argument_that_grows_without_end_is_not_taken(read) -> None:
    """Each doubles the one before: no entity is needed for that."""
    grow = "".join(f'<arg name="a{i + 1}" default="$(arg a{i})$(arg a{i})"/>' for i in range(60))
    inner = '<param name="laser_model_type" value="$(arg a60)"/>'
    text = launch(inner).replace("<launch>", f'<launch><arg name="a0" default="beam"/>{grow}')
    config, remarks = read(text)
    assert config.sensor_model == "likelihood_field_cubes"
    assert any("laser_model_type is not taken" in remark for remark in remarks)
