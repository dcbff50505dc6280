import numpy as np


def grid_localization(belief, motion, likelihood):
    n = len(belief)
    new = np.zeros(n)
    for k in range(n):
        total = 0.0
        for i in range(n):
            total = total + motion[k][i] * belief[i]
        new[k] = likelihood[k] * total
    return new / np.sum(new)
