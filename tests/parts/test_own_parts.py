"""Parts of a user's own: the examples of the docs, run as they stand there, and what is said of parts that fail."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from shown import write_shown

from pipeline.config import Config, dump_config, load_config
from pipeline.errors import MclError
from pipeline.localization import localize
from pipeline.logs.messages import Log, Trajectory

FEW = {"max_particles": 500, "min_particles": 500}


@pytest.fixture(scope="module")
def examples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_shown("own_parts.md", tmp_path_factory.mktemp("examples"))


@pytest.fixture(scope="module")
def drive(office: Log) -> Log:
    return office.part(slice(60))


@pytest.fixture(scope="module")
def way(office: Log) -> Trajectory:
    assert office.ground_truth is not None
    return office.ground_truth


def error(log: Log, way: Trajectory, config: Config) -> float:
    """Median distance from the truth, m, of a run from the true start."""
    pose = tuple(way.poses[0].tolist())
    known = config.model_copy(
        update={"initial_pose": pose, "initial_pose_std": (0.2, 0.2, 0.1), "recovery": "none"}
        | ({"init": "pose"} if config.init == "exhaustive" else {})
    )
    result = localize(log, known, seed=1)
    np.testing.assert_array_equal(result.poses, localize(log, known, seed=1, threads=1).poses)
    truth = np.stack([np.interp(log.stamps, way.stamps, way.poses[:, k]) for k in (0, 1)])
    return float(np.median(np.hypot(*(result.poses[:, :2].T - truth))))


@pytest.mark.parametrize(
    ("settings", "most"),
    [
        (["motion_model={}/omni.py:omni", "odometry=wheels"], 0.2),
        (["motion_model={}/omni.py:omni", "motion_model.across=0.4"], 0.2),
        (["motion_model={}/slipping.py:slipping", "odometry=wheels"], 0.25),
        (["motion_model={}/slipping.py:slipping"], 0.2),
        (["sensor_model={}/my_laser.py:density"], 0.2),
        (["sensor_model={}/slow_laser.py:likelihood"], 0.2),
        (["resampler={}/survival.py:stratified"], 0.2),
        (["filter={}/reckoning.py:Reckoning"], 0.5),
        (["filter=ekf"], 0.2),
        (["motion_model=omnidirectional", "odometry=wheels"], 0.2),
    ],
    ids=lambda value: str(value)[:40],
)
def test_the_examples_follow_the_robot(
    examples: Path, drive: Log, way: Trajectory, settings: list[str], most: float
) -> None:
    config = load_config(None, [text.format(examples) for text in settings], max_particles=1000, min_particles=1000)
    assert error(drive, way, config) < most


def test_the_first_belief_is_where_it_says(examples: Path, drive: Log) -> None:
    from pipeline.filter.initialization import initial_particles

    config = load_config(None, [f"init={examples}/survival.py:in_the_lab", "init.right=5"], **FEW)
    assert drive.grid is not None
    x, y, _ = drive.grid.to_map(initial_particles(drive.grid, config, 3).T.astype(np.float64)).T
    assert (pytest.approx(x.min(), abs=0.05), pytest.approx(x.max(), abs=0.05)) == (2.0, 5.0)
    assert (pytest.approx(y.min(), abs=0.05), pytest.approx(y.max(), abs=0.05)) == (1.0, 6.0)
    assert localize(drive.part(slice(3)), config).poses.shape == (3, 3)


def test_the_robot_is_found_with_an_own_beam_model(examples: Path, drive: Log, way: Trajectory) -> None:
    config = load_config(None, [f"sensor_model={examples}/my_laser.py:density"], max_particles=3000)
    found = localize(drive, config).poses[-1]
    assert np.hypot(*(way.poses[:, :2] - found[:2]).T).min() < 0.2


def test_a_saved_configuration_means_the_same_from_any_folder(examples: Path, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.chdir(examples)
    config = load_config(None, ["resampler=survival.py:stratified"])
    monkeypatch.chdir(tmp_path)
    (tmp_path / "c.yaml").write_text(dump_config(config))
    assert load_config(tmp_path / "c.yaml") == config


@pytest.mark.parametrize(
    ("source", "settings", "line", "said"),
    [
        ("def part(weights, n)\n    return 1", ["resampler"], 1, "cannot be loaded: SyntaxError"),
        ("import nowhere_at_all", ["resampler"], 1, "nowhere_at_all"),
        ("def other(weights, n):\n    return 1", ["resampler"], None, "there is no 'part' in it"),
        ("def part(weights):\n    return 1", ["resampler"], 1, r"expected \(weights, n\) \(and .* config, rng\)"),
        ("\ndef part(weights, n, luck):\n    return 1", ["resampler"], 2, r"takes \(weights, n, luck\)"),
        ("def part(weights, n, **more):\n    return 1", ["resampler"], 1, "names its arguments"),
        ("class part:\n    def throw(self):\n        pass", ["resampler"], 1, r"has no method draw\(weights, n\)"),
        ("def part(weights, n, luck=1.0):\n    pass", ["resampler", "resampler.lock=2"], None, "mean 'resampler.luck'"),
        ("def part(weights, n, luck=1.0):\n    pass", ["resampler", "resampler.luck=x"], None, "luck: .*number"),
        ("def part(weights, n, luck=1):\n    pass", ["resampler", "resampler.luck=0.5"], None, "with a point"),
        ("def part(before, after, expected):\n    pass", ["motion_model"], 1, "is not given 'expected'"),
        ("def part(weights, *, n):\n    pass", ["resampler"], 1, "'n' by its place"),
        ("def part(weights, n, rng, /):\n    pass", ["resampler"], 1, "'rng' by its name"),
        ("class part:\n    def draw(self, weights, n, luck=1.0):\n        pass", ["resampler", "resampler.luck=2"],
         None, "stand in the constructor"),
        ("def part(weights, n, luck=[]):\n    pass", ["resampler"], 1, "only numbers"),
        ("part = 3", ["resampler"], None, "neither a function nor a class"),
    ],
)  # fmt: skip
def test_a_part_that_cannot_be_used_is_refused_at_once(
    tmp_path: Path, source: str, settings: list[str], line: int | None, said: str
) -> None:
    path = tmp_path / "mine.py"
    path.write_text(source)
    first, *more = settings
    with pytest.raises(MclError, match=said) as caught:
        load_config(None, [f"{first}={path}:part", *more])
    assert caught.value.line == line


@pytest.mark.parametrize(
    ("name", "said"),
    [("sensor_model=bean", "did you mean 'beam'"), ("filter=a b", "expected mcl, grid, ekf, or a part of your own"),
     ("filter=no/such.py:Filter", "no such file"), ("filter=no_such_module:Filter", "cannot be loaded"),
     ("filter.size=3", "unknown parameter 'filter.size'")],
)  # fmt: skip
def test_a_name_that_is_none_is_refused(name: str, said: str) -> None:
    with pytest.raises(MclError, match=said):
        load_config(None, [name])


@pytest.mark.parametrize(
    ("role", "source", "line", "said"),
    [
        ("resampler", "def part(weights, n):\n    return [0] * (n - 1)", 1, "array of .499,., expected indices"),
        ("resampler", "def part(weights, n):\n    return [n + 10**6] * n", 1, "index outside 0 to 499"),
        ("resampler", "import numpy as np\ndef part(weights, n):\n    return np.arange(n) + 0.5", 2, "no indices"),
        ("resampler", "import numpy as np\ndef part(weights, n):\n    return weights > 0", 2, "bool values"),
        ("motion_model", "def part(poses, before, after):\n    poses[:] = 0", 1, "returned nothing"),
        ("motion_model", "import math\ndef part(poses, before, after):\n    return math.exp(poses)", 3, "np.exp"),
        ("motion_model", "import numpy as np\ndef part(old, new):\n    return new + 1e9, np.eye(3)", 2, "as large"),
        ("filter", "class part:\n    def update(self, scan, step):\n        return 0.0, 1.0", 1, r"particles of \(\)"),
        ("filter", "import numpy as np\nclass part:\n    def update(self, scan, step):\n"
         "        return np.zeros(3), -np.eye(3)", 2, "negative in some direction"),
        ("filter", "import numpy as np\nclass part:\n    def update(self, scan, step):\n"
         "        return np.zeros((100, 3)), np.ones(100)", 2, r"particles of \(100, 3\)"),
        ("resampler", "def part(weights, n):\n    x = 1\n    return 1 / (x - 1)", 3, "ZeroDivisionError"),
        ("motion_model", "def part(poses, before, after):\n    return poses * float('nan')", 1, "not finite"),
        ("motion_model", "def part(poses, before, after):\n    return poses.T", 1, "expected poses, .3, 256"),
        ("motion_model", "def part(before, after):\n    return after", 1, "expected a step"),
        ("motion_model", "import numpy as np\ndef part(before, after):\n    return after, -np.eye(3)", 2, "negative"),
        ("sensor_model", "def part(z, expected):\n    return -z", 1, "gave the density -"),
        ("sensor_model", "def part(poses, ranges):\n    return ranges", 1, "expected log-likelihoods, .500,"),
        ("init", "def part(n):\n    return [[0.0] * 3] * n", 1, "expected poses, .3, 500"),
        ("filter", "class part:\n    def update(self, scan, step):\n        return None", 1, "expected a pose and its"),
    ],
)  # fmt: skip
def test_what_a_part_must_not_return_is_told_with_its_place(
    tmp_path: Path, drive: Log, role: str, source: str, line: int, said: str
) -> None:
    path = tmp_path / "mine.py"
    path.write_text(source)
    wheels = {"odometry": "wheels", "resample_ess": 1.0, "init": "free_space"}
    config = load_config(None, [f"{role}={path}:part"], **FEW, **({} if role == "init" else wheels))
    with pytest.raises(MclError, match=said) as caught:
        localize(drive.part(slice(30)), config)
    assert (caught.value.path, caught.value.line) == (path, line)


def test_what_is_given_is_no_parameter_and_none_is_a_value(tmp_path: Path, drive: Log) -> None:
    (tmp_path / "mine.py").write_text(
        "def part(weights, n, rng=None, config=None, start=None):\n"
        "    assert rng is not None and config.max_particles == 500\n"
        "    return rng.choice(len(weights), n, p=weights / weights.sum())\n"
    )
    config = load_config(None, [f"resampler={tmp_path}/mine.py:part"], **FEW)
    assert config.own == {"resampler.start": None}
    (tmp_path / "c.yaml").write_text(dump_config(config))
    assert load_config(tmp_path / "c.yaml") == config
    short = drive.part(slice(20))
    np.testing.assert_array_equal(localize(short, config, seed=3).poses, localize(short, config, seed=3).poses)


def test_a_part_cannot_change_what_it_is_given(tmp_path: Path, drive: Log) -> None:
    (tmp_path / "mine.py").write_text(
        "def rough(poses, before, after):\n    before += 5\n    after[:] = 1e5\n    return poses\n"
        "def gentle(poses, before, after):\n    return poses\n"
    )
    short, found = drive.part(slice(20)), []
    for name in ("rough", "gentle"):
        config = load_config(None, [f"motion_model={tmp_path}/mine.py:{name}", "odometry=wheels"], **FEW)
        found.append(localize(short, config).poses)
    np.testing.assert_array_equal(*found)


def test_a_compiled_function_is_taken_as_it_is(tmp_path: Path, drive: Log, way: Trajectory) -> None:
    path = tmp_path / "compiled.py"
    path.write_text(
        "import numba\nimport numpy as np\n@numba.njit\n"
        "def density(z, expected, spread=0.1):\n"
        "    out = np.empty(z.shape)\n"
        "    for i in range(z.size):\n"
        "        off = abs(z.flat[i] - expected.flat[i])\n"
        "        out.flat[i] = 0.5 * np.exp(-off / spread) / (2 * spread) + 0.005\n"
        "    return out\n"
    )
    config = load_config(None, [f"sensor_model={path}:density"], max_particles=1000, min_particles=1000)
    assert config.own == {"sensor_model.spread": 0.1}
    assert error(drive, way, config) < 0.2
