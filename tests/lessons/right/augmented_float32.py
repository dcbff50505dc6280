import numpy as np


def random_share(likelihood, slow, fast, rate_slow, rate_fast):
    rates = np.array([rate_slow, rate_fast], np.float32)
    slow, fast = (1 - rates) * np.array([slow, fast], np.float32) + rates * np.float32(likelihood)
    return [slow, fast, np.clip(1 - fast / slow, 0, None)]
