import numpy as np


def low_variance_sampler(weights, rng):
    """By how many teeth stand below the end of each particle's weight, in single precision and shuffled at the end."""
    n = len(weights)
    start = np.float32(rng.uniform(0, 1))
    below = np.ceil(np.cumsum(weights, dtype=np.float32) * n - start).clip(0, n).astype(int)
    below[-1] = n
    copies = np.diff(below, prepend=0)
    survivors = np.repeat(np.arange(n), copies)
    rng.shuffle(survivors)
    return survivors.astype(np.float32)
