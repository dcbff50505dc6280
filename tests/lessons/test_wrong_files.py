"""Files that cannot be judged: one line, with the file and the line in it, and what is wrong there."""

from __future__ import annotations

import pytest

from pipeline.errors import MclError

HEAD = "def kld_particles(bins, epsilon, quantile):\n"
FILES = {
    "raises": (HEAD + "    x = 1\n    return x / 0\n", r"mine\.py:3: ZeroDivisionError: division by zero"),
    "raises deeper": ("def f(x):\n    return x.y\n" + HEAD + "    return f(1)\n", r"mine\.py:2: AttributeError"),
    "raises in numpy": (
        "import numpy as np\n" + HEAD + "    return np.ones(2) @ np.ones(3)\n",
        r"mine\.py:3: ValueError: ",
    ),
    "nothing returned": (HEAD + "    bins + 1\n", r"mine\.py:2: particles should be numbers, and it returned nothing"),
    "text returned": (HEAD + "    return 'many'\n", r"mine\.py:2: particles should be numbers, .* a str"),
    "wrong shape": (HEAD + "    if bins:\n        return [1, 2]\n", r"mine\.py:3: .* the shape \(\), and has \(2,\)"),
    "not a number": (HEAD + "    a = 1\n    return float('nan')\n", r"mine\.py:3: particles is not a number \(NaN\)"),
    "no Python": ("def kld_particles(bins, epsilon, quantile)\n    return 1\n", r"mine\.py:1: this is no Python"),
    "another name": (
        "def kld(a, b, c):\n    return 1\n",
        r"mine\.py: there is no function kld_particles .*defines kld",
    ),
    "other parameters": ("def kld_particles(bins):\n    return 1\n", r"mine\.py: .*takes 1 positional argument"),
    "fails while it is loaded": ("import math\nmath.sqr(2)\n" + HEAD + "    return 1\n", r"mine\.py:2: AttributeError"),
    "ends the program": ("import sys\nsys.exit(0)\n" + HEAD + "    return 1\n", r"mine\.py:2: .*ends the program"),
    "no end": (
        HEAD + "    while True:\n        bins += 1\n",
        r"mine\.py:[23]: kld_particles was still busy after 0\.5 s",
    ),
    "no end, whatever is raised": (
        HEAD + "    while True:\n        try:\n            bins += 1\n        except Exception:\n            pass\n",
        r"mine\.py:\d: kld_particles was still busy after 0\.5 s",
    ),
}


@pytest.mark.parametrize(("source", "said"), FILES.values(), ids=FILES.keys())
def test_one_line_says_where_and_what(source, said, judged):
    with pytest.raises(MclError, match=said) as raised:
        judged(source, "8.4", patience=0.5)
    assert "\n" not in str(raised.value)


def test_an_exception_that_a_mistake_raises_too_names_the_mistake(judged):
    source = (
        "import numpy as np\n"
        "def low_variance_sampler(weights, rng):\n"
        "    teeth = (rng.random() + np.arange(len(weights))) / len(weights)\n"
        "    return np.searchsorted(np.cumsum(weights), teeth) + 1\n"
    )
    with pytest.raises(MclError, match=r"mine\.py:4: .*the index 8 survived \(.*the indices count from 1\)"):
        judged(source)


def test_two_things_are_wanted_and_one_is_returned(judged):
    source = "def ekf_update(mean, covariance, z, landmark, deviations):\n    return mean\n"
    with pytest.raises(MclError, match=r"mine\.py:2: it should return 2 things, mean, covariance"):
        judged(source)


def test_a_file_may_import_what_lies_beside_it(judged, tmp_path):
    (tmp_path / "beside_mine.py").write_text("def bound(k, e, z):\n    return 0.0\n")
    judgement = judged("from beside_mine import bound as kld_particles\n", "8.4")
    assert not judgement.answers_right


def test_a_number_that_is_wrong_by_a_factor_is_told(judged):
    source = (
        "import math\n" + HEAD + "    if bins <= 1:\n        return 1.0\n    a = 2 / (9 * (bins - 1))\n"
        "    return 2 * (bins - 1) / (2 * epsilon) * (1 - a + math.sqrt(a) * quantile) ** 3\n"
    )
    assert "all 2 times what they should be" in judged(source).relation


def test_wrong_answers_come_with_their_groups_and_the_worst_first(judged):
    source = HEAD + "    return 1.0 if bins <= 1 else 5.0\n"
    judgement = judged(source)
    assert [bool(group.wrong) for group in judgement.groups] == [False, True, True, True]
    worst = judgement.groups[1].wrong[0]
    assert worst.answer == 5.0
    assert worst.expected == max(wrong.expected for wrong in judgement.groups[1].wrong)
    assert not judgement.right
