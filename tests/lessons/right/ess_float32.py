import numpy as np


def effective_sample_size(lw):
    """(sum w)^2 / sum w^2, in which the sum of the weights does not matter."""
    lw = np.asarray(lw - np.max(lw), dtype=np.float32)
    w = np.exp(lw)
    return np.array([w.sum() ** 2 / (w @ w)])
