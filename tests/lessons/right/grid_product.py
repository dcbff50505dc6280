import numpy as np


def grid_localization(p, transition, q):
    p = transition.astype(np.float32) @ p.astype(np.float32)
    p *= q
    p /= p.sum()
    return p
