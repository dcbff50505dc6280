"""Random numbers by counter: a number is a function of (seed, scan, purpose) and the particle's index.

No state is carried from one particle to the next, so results are the same for any number of threads. The mixing is
SplitMix64's finalizer (Steele, Lea and Flood, OOPSLA 2014), applied to key + index * golden ratio.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels import inline, kernel, normal

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX2 = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_INV_2_53 = 1.0 / (1 << 53)
_MASK = (1 << 64) - 1


def stream_key(seed: int, scan: int, purpose: int) -> np.uint64:
    """Key of an independent stream of numbers: all three are mixed, so that no two streams overlap in practice."""
    key = 0
    for part in (seed, scan, purpose):
        key = (key + (part & _MASK) + int(_GOLDEN)) & _MASK
        key = ((key ^ (key >> 30)) * int(_MIX1)) & _MASK
        key = ((key ^ (key >> 27)) * int(_MIX2)) & _MASK
        key ^= key >> 31
    return np.uint64(key)


def normal_quantiles() -> NDArray[np.float32]:
    """Quantiles of the standard normal at (i + 1/2) / 65536, (65536,) float32: sixteen random bits become a normal
    by one look-up, up to 4.3 standard deviations out."""
    out = np.empty(65536)
    normal.quantiles((np.arange(65536) + 0.5) / 65536, out)
    return out.astype(np.float32)


@inline
def random_bits(key, index):
    """64 random bits."""
    z = key + (np.uint64(index) + np.uint64(1)) * _GOLDEN
    z = (z ^ (z >> _S30)) * _MIX1
    z = (z ^ (z >> _S27)) * _MIX2
    return z ^ (z >> _S31)


@inline
def uniform(key, index):
    """A double in [0, 1)."""
    return float(random_bits(key, index) >> _S11) * _INV_2_53


@kernel
def uniforms(key, n):
    """(n,) float64 in [0, 1)."""
    out = np.empty(n)
    for i in range(n):
        out[i] = uniform(key, i)
    return out
