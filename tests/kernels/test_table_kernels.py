"""What the table of ranges is built with, and the sum that tells whether it is whole."""

from __future__ import annotations

import numpy as np
import pytest
import reference

from pipeline.kernels import table


@pytest.mark.parametrize("seed", range(4))
def test_clearance_is_the_distance_in_king_s_moves(seed: int) -> None:
    rng = np.random.default_rng(seed)
    opaque = np.pad((rng.random((23, 31)) < 0.02).astype(np.uint8), 1)
    found = np.empty_like(opaque)
    table.clearance(opaque, found)
    np.testing.assert_array_equal(found, reference.clearance(opaque))


def mixed(words: np.ndarray, work: int = 0) -> list[int]:
    sums = np.empty(-(-len(words) // table.WORDS), np.uint64)
    table.mix(work, words, sums)
    return [int(s) for s in sums]


def test_the_sum_that_tells_damage() -> None:
    words = np.random.default_rng(0).integers(0, 2**64, 2 * table.WORDS + 77, np.uint64)
    sums = mixed(words)
    assert sums == mixed(words, work=10**9)
    assert sums[2] == reference.mix(words[2 * table.WORDS :], 2 * table.WORDS)
    for bit in range(64):
        damaged = words.copy()
        damaged[5] ^= np.uint64(1) << np.uint64(bit)
        assert mixed(damaged)[0] != sums[0]
    swapped = words.copy()
    swapped[[3, 4]] = words[[4, 3]]
    assert mixed(swapped)[0] != sums[0]
