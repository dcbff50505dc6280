import numpy as np


def low_variance_sampler(w, generator):
    n = w.size
    teeth = (generator.random() + np.arange(n)) / n
    cumulative = np.cumsum(w)
    return np.minimum(np.searchsorted(cumulative, teeth), n - 1)
