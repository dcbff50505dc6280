import numpy as np


def kld_particles(k, err, z):
    b = np.float32(k - 1)
    if b == 0:
        return 1
    inner = 1 - 2 / 9 / b + z * np.sqrt(2 / 9 / b)
    return int(np.ceil(b * inner**3 / err / 2))
