"""Right files with one thing changed are flagged: signs, operators, comparisons, indices, orders, calls, units.

MUTANTS=all asks for every one of them, which takes two minutes.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from mutants import Mutant, mutants
from right_files import RIGHT, lesson_of

from pipeline.errors import MclError
from pipeline.lessons.judging import judge

BOOKISH = (
    "low_variance_loop", "ess_loop", "motion_density_loop", "motion_sampling_loop", "beam_model_loop",
    "ray_casting_dda", "likelihood_field_loop", "ekf_book", "grid_loop", "augmented_plain", "kld_plain",
)  # fmt: skip
OF_EACH = 12
"""Mutants of every file that are tried, evenly spread; fewer if there are fewer."""

SAME = {
    "low_variance_loop": {
        "line 12: tooth > total  ->  tooth >= total": "a tooth stands on a border with probability zero",
        "line 12: i < n - 1  ->  i <= n - 1": "guards against rounding of the last sum only",
        "line 12: n - 1  ->  n + 1": "guards against rounding of the last sum only",
    },
    "motion_density_loop": {
        "line 14: b[0] - a[0]  ->  a[0] - b[0]": "in hypot, which squares it",
        "line 14: b[1] - a[1]  ->  a[1] - b[1]": "in hypot, which squares it",
        "line 15: b[2] - a[2] - rot1  ->  rot1 - (b[2] - a[2])": "of both moves: the difference is squared",
        "line 26: trans - hat_trans  ->  hat_trans - trans": "it is squared",
        "line 25: rot1 - hat1  ->  hat1 - rot1": "it is squared",
        "line 27: rot2 - hat2  ->  hat2 - rot2": "it is squared",
    },
    "motion_sampling_loop": {
        "line 7: a >= pi  ->  a > pi": "both are the same angle",
        "line 9: a < -pi  ->  a <= -pi": "both are the same angle",
        "line 17: now[0] - before[0]  ->  before[0] - now[0]": "in hypot, which squares it",
        "line 17: now[1] - before[1]  ->  before[1] - now[1]": "in hypot, which squares it",
        "line 24: rot1 - rng.normal(0, s1)  ->  rot1 + rng.normal(0, s1)": "the noise is symmetrical",
        "line 25: trans - rng.normal(0, st)  ->  trans + rng.normal(0, st)": "the noise is symmetrical",
        "line 26: rot2 - rng.normal(0, s2)  ->  rot2 + rng.normal(0, s2)": "the noise is symmetrical",
        "line 29: wrap(theta + r1 + r2)  ->  theta + r1 + r2": "whole turns count for nothing",
    },
    "beam_model_loop": {
        "line 5: 1.0  ->  2.0": "in below(), whose differences alone are used",
        "line 13: measured - true  ->  true - measured": "it is squared",
    },
    "ray_casting_dda": {
        "line 10: 0.0  ->  1.0": "the way before the first border, which is never used",
        "line 14: to_x < to_y  ->  to_x <= to_y": "exactly through a corner: either cell may come first",
        "line 20: travelled > far  ->  travelled >= far": "exactly as far as max_range: it is max_range either way",
        "line 16: dx > 0  ->  dx >= 0": "a ray along the other axis meets no such border",
        "line 19: dy > 0  ->  dy >= 0": "a ray along the other axis meets no such border",
        "line 12: dx > 0  ->  dx >= 0": "a ray along the other axis meets no such border",
        "line 13: dy > 0  ->  dy >= 0": "a ray along the other axis meets no such border",
    },
    "grid_loop": {
        "line 10: total + motion[k][i] * belief[i]  ->  total - motion[k][i] * belief[i]": "all change their sign, "
        "and so does the sum that they are divided by",
    },
    "augmented_plain": {"line 5: share < 0.0  ->  share <= 0.0": "zero either way"},
}
"""Changes that change nothing, and why."""


def chosen(name: str) -> list[Mutant]:
    source = (RIGHT / f"{name}.py").read_text()
    found = [m for m in mutants(source, lesson_of(source).function) if str(m) not in SAME.get(name, {})]
    if os.environ.get("MUTANTS") == "all":
        return found
    step = max(1.0, len(found) / OF_EACH)
    return [found[int(k * step)] for k in range(min(OF_EACH, len(found)))]


def flagged(mutant: Mutant, path: Path) -> bool:
    path.write_text(mutant.source)
    try:
        return not judge(lesson_of(mutant.source), path, patience=3.0, always_on_log=False).right
    except MclError:
        return True


@pytest.fixture(scope="module")
def told() -> dict[str, list[bool]]:
    return {}


@pytest.mark.parametrize("name", BOOKISH)
def test_what_is_changed_is_flagged(name: str, tmp_path: Path, told: dict[str, list[bool]]):
    found = chosen(name)
    assert len(found) >= 10
    told[name] = [flagged(mutant, tmp_path / "mutant.py") for mutant in found]
    missed = [str(mutant) for mutant, ok in zip(found, told[name], strict=True) if not ok]
    assert len(missed) <= 0.1 * len(found), missed


def test_of_all_of_them_nine_in_ten_are(told: dict[str, list[bool]]):
    rows = [ok for row in told.values() for ok in row]
    assert len(rows) >= 30
    assert sum(rows) >= 0.9 * len(rows)


def test_what_changes_nothing_is_still_there_to_be_left_out():
    for name, reasons in SAME.items():
        source = (RIGHT / f"{name}.py").read_text()
        assert reasons.keys() <= {str(m) for m in mutants(source, lesson_of(source).function)}, name
