"""Values of a parameter side by side: what is typed, and what is told."""

from __future__ import annotations

import json

import pytest
from PIL import Image
from test_evaluate import make_log, stub

from pipeline.config import Config, load_config
from pipeline.errors import MclError
from pipeline.evaluate import Comparison, compare, evaluate, plot, variants


def configure(values) -> Config:
    return load_config(None, values)


def comparison(*typed: str, logs=("a", "b"), runs: int = 4, **options) -> Comparison:
    keys, found = variants(typed, configure)
    cases = [make_log(name) for name in logs]
    configs = [variant.config for variant in found]
    done = compare(cases, [None] * len(cases), configs, runs, jobs=1, runner=stub, **options)
    return Comparison(keys, found, done)


def test_every_value_is_a_configuration() -> None:
    keys, found = variants(["max_beams=10, 20,30"], configure)
    assert keys == ("max_beams",)
    assert [(v.label, v.config.max_beams) for v in found] == [("10", 10), ("20", 20), ("30", 30)]


def test_commas_within_brackets_part_no_values() -> None:
    _, found = variants(["initial_pose=[1, 2, 0],[3, 4, 0],null"], configure)
    assert [v.config.initial_pose for v in found] == [(1.0, 2.0, 0.0), (3.0, 4.0, 0.0), None]


def test_two_parameters_are_combined() -> None:
    keys, found = variants(["max_beams=10,20", "z_hit=0.5,1"], configure)
    assert keys == ("max_beams", "z_hit")
    assert [v.label for v in found] == ["10, 0.5", "10, 1", "20, 0.5", "20, 1"]
    assert [(v.config.max_beams, v.config.z_hit) for v in found] == [(10, 0.5), (10, 1.0), (20, 0.5), (20, 1.0)]


def test_nothing_varied_is_a_single_nameless_variant() -> None:
    keys, found = variants([], configure)
    assert keys == ()
    assert [(v.label, v.config) for v in found] == [("", Config())]


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("max_beams", "expected KEY=V1,V2"),
        ("max_beams=10", "two values or more"),
        ("max_beams=10,,20", "two values or more"),
        ("max_beams=10,20,", "two values or more"),
        ("=1,2", "expected KEY=V1,V2"),
        ("sensor_modle=beam", "did you mean 'sensor_model'"),
        ("max_beam=1,2", "unknown parameter 'max_beam'"),
        ("max_beams=1,many", "max_beams: .*many"),
        ("z_hit=1,1.0", "'1' and '1.0' come to the same"),
        ("sensor_model=beam,bean", "sensor_model: .*bean"),
    ],
)
def test_what_cannot_be_varied(typed: str, said: str) -> None:
    with pytest.raises(MclError, match=said):
        variants([typed], configure)


def test_an_option_that_wins_leaves_nothing_to_vary() -> None:
    with pytest.raises(MclError, match=r"come to the same configuration .*--particles"):
        variants(["max_particles=1000,2000"], lambda values: load_config(None, values, max_particles=500))


def test_one_table_with_a_row_for_each_log_and_value() -> None:
    found = comparison("max_beams=10,20", kidnapped_at=[30.0])
    assert [row[:2] for row in found.table()] == [("a", "10"), ("a", "20"), ("b", "10"), ("b", "20")]
    assert found.columns[:3] == ("log", "max_beams", "success")
    assert {len(row) for row in found.table()} == {len(found.columns)}
    assert [row[:3] for row in found.recovery_table()] == [
        ("a", "10", "30.0"),
        ("b", "10", "30.0"),
        ("a", "20", "30.0"),
        ("b", "20", "30.0"),
    ]
    assert {len(row) for row in found.recovery_table()} == {len(found.recovery_columns)}


def test_each_value_gets_the_runs_that_it_would_get_alone() -> None:
    """The same seeds for all, and each run with its own configuration."""
    seen = []

    def runner(log, config, *, seed, threads):
        seen.append((config.max_beams, log.name, seed))
        return stub(log, config, seed=seed + 100 * config.max_beams, threads=threads)

    _, found = variants(["max_beams=10,20"], configure)
    configs, log = [v.config for v in found], make_log()
    together = compare([log], [None], configs, 3, 1, 5, runner=runner)
    assert seen == [(beams, "ring", seed) for beams in (10, 20) for seed in (5, 6, 7)]
    for config, done in zip(configs, together, strict=True):
        alone = evaluate([log], [None], config, 3, 1, 5, runner=runner)
        assert done.config == config
        for one, other in zip(done.logs[0].runs, alone.logs[0].runs, strict=True):
            assert (one.seed, one.poses.tobytes()) == (other.seed, other.poses.tobytes())


def test_json() -> None:
    told = comparison("sensor_model=beam,likelihood_field", "max_beams=10,20", logs=["a"]).to_dict()
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    assert told["vary"] == ["sensor_model", "max_beams"]
    assert told["variants"][2]["values"] == {"sensor_model": "likelihood_field", "max_beams": 10}
    assert {"values", "logs", "config", "versions"} <= told["variants"][0].keys()
    assert told["variants"][0]["logs"]["a"]["runs"] == 4


def test_the_plot_has_a_row_for_each(tmp_path) -> None:
    heights = []
    for typed in (["max_beams=10,20"], ["max_beams=10,20,30"]):
        plot(comparison(*typed, logs=["a"], runs=2), tmp_path / "out.png")
        with Image.open(tmp_path / "out.png") as image:
            heights.append(image.height)
    assert heights[1] == pytest.approx(1.5 * heights[0], rel=0.01)
