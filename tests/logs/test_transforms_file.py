"""Static transforms that a file says, for a recording that has none."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import MclError
from pipeline.logs.reader import read_log
from pipeline.logs.recorded import Names
from pipeline.logs.transforms_file import read_transforms
from recordings import UPRIGHT, Recording

ECHOED = """\
transforms:
- header:
    stamp:
      sec: 1700000000
      nanosec: 0
    frame_id: base_footprint
  child_frame_id: base_link
  transform:
    translation:
      x: 0.0
      y: 0.0
      z: 0.1
    rotation:
      x: 0.0
      y: 0.0
      z: 0.0
      w: 1.0
- header: {stamp: {sec: 0, nanosec: 0}, frame_id: /base_link}
  child_frame_id: hokuyo_link
  transform:
    translation: {x: 0.2, y: -0.1, z: 0.3}
    rotation: {x: 0.0, y: 0.0, z: 0.7071068, w: 0.7071068}
---
"""
TYPED = """\
- {parent: base_footprint, child: base_link, z: 0.1}
- {parent: base_link, child: hokuyo_link, x: 0.2, y: -0.1, z: 0.3, yaw: 1.5707963}
"""


def recorded(tmp_path: Path) -> Path:
    recording = Recording()
    for k in range(20):
        recording.odometry(k * 10**8, 0.1 * k, 0.0, 0.0)
        recording.scan(k * 10**8, [1.0, 2.0, 3.0, 4.0, 5.0])
    return recording.write(tmp_path / "without.mcap")


@pytest.mark.parametrize("text", [ECHOED, TYPED], ids=["echoed", "typed"])
def test_the_laser_sits_where_the_file_says(text: str, tmp_path: Path) -> None:
    path = recorded(tmp_path)
    with pytest.raises(MclError, match="--tf FILE"):
        read_log(path)
    (tmp_path / "tf.yaml").write_text(text)
    log = read_log(path, names=Names(transforms=read_transforms(tmp_path / "tf.yaml")))
    assert log.laser.pose == pytest.approx((0.2, -0.1, math.pi / 2), abs=1e-6)


def test_a_laser_that_hangs_upside_down_has_its_beams_the_other_way_round(tmp_path: Path) -> None:
    (tmp_path / "tf.yaml").write_text(f"- {{parent: base_footprint, child: hokuyo_link, roll: {math.pi}}}\n")
    log = read_log(recorded(tmp_path), names=Names(transforms=read_transforms(tmp_path / "tf.yaml")))
    np.testing.assert_array_equal(log.ranges[0], [5.0, 4.0, 3.0, 2.0, 1.0])


def test_the_file_counts_before_the_recording(tmp_path: Path) -> None:
    recording = Recording()
    for k in range(20):
        recording.odometry(k * 10**8, 0.1 * k, 0.0, 0.0)
        recording.scan(k * 10**8, [1.0, 2.0])
    recording.transforms(("base_footprint", "hokuyo_link", (9.0, 0.0, 0.0), UPRIGHT))
    (tmp_path / "tf.yaml").write_text("- {parent: base_footprint, child: hokuyo_link, x: 0.5}\n")
    names = Names(transforms=read_transforms(tmp_path / "tf.yaml"))
    assert read_log(recording.write(tmp_path / "a.mcap"), names=names).laser.pose == (0.5, 0.0, 0.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no transforms in this file"),
        ("a: [1", "not YAML"),
        ("Dear robot", "not a list of transforms"),
        ("- {parent: a}", "'child' is missing"),
        ("- {parent: a, child: a}", "no two frames"),
        ("- {parent: a, child: b, x: far}", "x is 'far'"),
        ("- {parent: a, child: b, x: .nan}", "x is nan"),
        ("- {parent: a, child: b, yaw: 5000}", "radians are expected"),
        ("- {parent: a, child: b, heading: 1}", "'heading'"),
        (ECHOED.replace("w: 1.0", "w: 0.0"), "length 0, not 1"),
        ("- 2024-13-45", "not"),
    ],
)
def test_what_it_is_not_is_told(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "tf.yaml").write_text(text)
    with pytest.raises(MclError, match=words) as error:
        read_transforms(tmp_path / "tf.yaml")
    assert "tf.yaml" in str(error.value)
