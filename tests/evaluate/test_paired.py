"""Variants seed by seed: the tests' p against counting by hand, and the table as CSV and LaTeX."""

from __future__ import annotations

import csv
import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest
from test_evaluate import make_log, stub

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.evaluate import Comparison, Variant, check_table, compare, write_table
from pipeline.evaluate.paired import PAIRED_COLUMNS, p_value, sign_test, signed_rank_test


def by_counting(more: int, less: int) -> float:
    """Of all ways in which so many fair coins fall, those that are as uneven or more."""
    n = more + less
    ways = sum(math.comb(n, k) for k in range(n + 1) if abs(k - n / 2) >= abs(more - n / 2))
    return ways / 2**n


def by_all_signs(differences: list[float]) -> float:
    """Wilcoxon's test from its definition: of all signs that the ranks might have, those as far from the middle."""
    ranks = np.argsort(np.argsort(np.abs(differences))) + 1
    middle = ranks.sum() / 2
    seen = abs(ranks[np.array(differences) > 0].sum() - middle)
    every = [abs(ranks[list(signs)].sum() - middle) for signs in itertools.product([False, True], repeat=len(ranks))]
    return float(np.mean([each >= seen for each in every]))


@pytest.mark.parametrize(("more", "less"), [(0, 0), (1, 0), (5, 0), (6, 1), (4, 4), (9, 3), (0, 12)])
def test_mcnemar_is_the_share_of_all_ways_the_coins_fall(more: int, less: int) -> None:
    assert sign_test(more, less) == pytest.approx(by_counting(more, less))


def test_wilcoxon_is_the_share_of_all_signs() -> None:
    rng = np.random.default_rng(5)
    for n in (5, 8, 10):
        differences = rng.normal(0.4, 1.0, n).tolist()
        assert signed_rank_test(differences) == pytest.approx(by_all_signs(differences))
    assert signed_rank_test([0.0, 0.0]) == 1.0
    assert signed_rank_test([1.0, 0.0, 2.0, 3.0]) == signed_rank_test([1.0, 2.0, 3.0])


def test_small_p_are_not_told_as_nothing() -> None:
    assert (p_value(0.0004), p_value(0.0625)) == ("< 0.001", "0.062")


def worse(log, config, *, seed: int, threads: int) -> SimpleNamespace:
    """With particles to spare as the stub; with few every even seed is lost, and the others err by 0.1 m more."""
    result = stub(log, config, seed=seed, threads=threads)
    if config.max_particles < 1000:
        result.poses[:, 0] += 20.0 if seed % 2 == 0 else 0.1
    return result


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    configs = [Config(max_particles=n, min_particles=100) for n in (5000, 500)]
    variants = tuple(Variant((str(config.max_particles),), config) for config in configs)
    logs = [make_log("a_1 & 50 %"), make_log("unknown", ground_truth=None)]
    done = compare(logs, [None, None], configs, runs=12, jobs=1, runner=worse)
    return Comparison(("max_particles",), variants, done)


def test_each_variant_is_held_against_the_first_seed_by_seed(comparison: Comparison) -> None:
    (paired,) = comparison.paired  # a log whose truth is not known has no row
    # Of the twelve seeds every fourth fails in any case, and of the others the even ones with few particles.
    assert (paired.log, paired.variant, paired.seeds) == ("a_1 & 50 %", "500", 12)
    assert (paired.only_this, paired.only_first) == (0, 6)
    assert paired.p_success == pytest.approx(2 / 2**6)
    assert paired.right.pairs == 12
    assert paired.right.median < 0.0
    assert paired.error.pairs == 3  # of the runs that find the robot with both
    assert 0.05 < paired.error.median < 0.15
    assert paired.error.p == pytest.approx(0.25)
    (row,) = comparison.paired_table()
    assert len(row) == len(comparison.paired_columns) == len(PAIRED_COLUMNS) + 1
    assert row[2:5] == ("0", "6", "0.031")
    assert comparison.to_dict()["paired"][0]["only_first"] == 6


def test_csv_has_every_figure_in_full(comparison: Comparison, tmp_path) -> None:
    write_table(comparison, tmp_path / "table.csv")
    with (tmp_path / "table.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["log"], row["max_particles"]) for row in rows] == [
        (log, n) for n in ("5000", "500") for log in ("a_1 & 50 %", "unknown")
    ]
    first, second = (comparison.evaluations[k].logs[0] for k in (0, 1))
    assert int(rows[0]["successes"]) == first.successes
    assert float(rows[0]["scans_right_median"]) == first.to_dict()["scans_right"]["median"]
    assert float(rows[2]["wall_seconds"]) == second.wall
    assert float(rows[2]["p_success"]) == pytest.approx(2 / 2**6)
    assert rows[0]["p_success"] == rows[1]["successes"] == ""
    assert float(rows[1]["together_all"]) == comparison.evaluations[0].logs[1].agreement.all.together


def test_latex_has_the_printed_table_with_nothing_that_latex_would_obey(comparison: Comparison, tmp_path) -> None:
    write_table(comparison, tmp_path / "table.tex")
    lines = (tmp_path / "table.tex").read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("%")
    scored = lines[1 : lines.index(r"\end{tabular}") + 1]
    (columns,) = [line for line in scored if line.startswith(r"\begin{tabular}")]
    count = len(columns.split("{")[2].strip("}"))
    rows = [line for line in scored if line.endswith(r" \\")]
    assert len(rows) == 3  # a heading, and two variants of the log whose truth is known
    assert all(row.replace(r"\&", "").count("&") == count - 1 for row in rows)
    assert rows[1].startswith(r"a\_1 \& 50 \% & 5000 & ")
    assert rows[2].endswith(r"\\")
    assert "0.031" in rows[2]
    assert "95 \\% CI" in rows[0]
    assert sum(line.startswith("unknown & ") for line in lines) == 2


def test_a_suffix_that_is_no_table_is_refused(tmp_path) -> None:
    with pytest.raises(MclError, match=r"a table is one of \.csv, \.tex"):
        check_table(tmp_path / "table.xlsx")
