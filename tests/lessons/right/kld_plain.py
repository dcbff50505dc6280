import math


def kld_particles(bins, epsilon, quantile):
    if bins <= 1:
        return 1.0
    k = bins - 1
    a = 2.0 / (9.0 * k)
    return k / (2.0 * epsilon) * (1.0 - a + math.sqrt(a) * quantile) ** 3
