"""Which way each particle takes: the same as in the move itself."""

from __future__ import annotations

import numpy as np

from pipeline.kernels import motion
from pipeline.kernels.random import stream_key


def test_who_takes_a_way_is_who_moves_by_it() -> None:
    n, key = 5000, stream_key(3, 4, 1)
    way_of = np.repeat(np.arange(4, dtype=np.int32), 64)
    taken = np.empty(n, np.int32)
    motion.taken(way_of, key, taken)
    # Every way leads so many metres straight ahead, without noise.
    ways = np.zeros((4, 12), np.float32)
    ways[:, 2] = np.arange(4)
    x, y, theta = np.zeros((3, n), np.float32)
    motion.move(n, x, y, theta, ways, way_of, key, np.zeros(65536, np.float32))
    np.testing.assert_array_equal(x, taken)
    assert (np.abs(np.bincount(taken, minlength=4) - n / 4) < 5 * np.sqrt(n * 3 / 16)).all()
