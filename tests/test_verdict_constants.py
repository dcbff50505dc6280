"""The script that gives the verdict its constants: it hears what a judge hears, and finds the weights behind data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import verdict as script
from scipy.special import expit

from pipeline.config import Config
from pipeline.judgement.verdict import stated
from pipeline.localization import localize
from pipeline.logs.messages import Log


def test_the_signs_that_are_kept_give_the_probabilities_of_the_run(office: Log, tmp_path: Path) -> None:
    # Two pieces of the drive with some seconds between them, so that nobody has seen the way: a judge hears of that.
    log = office.part(np.r_[0:40, 120:160])
    signer = script.Signer()
    result = localize(log, Config(max_particles=2000), seed=0, threads=1, sinks=[signer])
    signs = np.array(signer.signs)
    assert signs[40, 4] == 1.0
    run = script.Run("run", "office", signs, np.zeros(len(signs), np.bool_), np.array(signer.explained))
    script.write(run, tmp_path / "run.npz")
    told = stated(*script.regressors(script.read(tmp_path / "run.npz"))[:, 1:].T)
    np.testing.assert_allclose(told, result.probability, atol=1e-8)
    assert np.ptp(told) > 0.1


def test_a_fit_finds_the_weights_by_which_the_data_were_made() -> None:
    rng, weights = np.random.default_rng(0), np.array([0.5, 0.3, 1.7, -1.0])
    xs = [np.column_stack([np.ones(20_000), rng.normal(size=(20_000, 3))]) for _ in range(2)]
    rights = [rng.random(len(x)) < expit(x @ weights) for x in xs]
    np.testing.assert_allclose(script.fitted(xs, rights), weights, atol=0.06)


def test_a_building_is_foretold_by_the_others_alone() -> None:
    rng = np.random.default_rng(0)
    xs = [np.column_stack([np.ones(500), rng.normal(size=(500, 3))]) for _ in range(3)]
    # In two buildings the third column tells, in the other one it tells the opposite.
    runs = [
        script.Run(name, name, np.zeros((500, 5)), sign * x[:, 2] > 0.0, np.zeros(500))
        for name, sign, x in zip("abc", (1, 1, -1), xs, strict=True)
    ]
    odd = script.foretold(runs, xs)[2]
    assert ((odd > 0.5) == runs[2].right).mean() < 0.2
