import numpy as np
from scipy.special import ndtr


def beam_range_finder_model(z, zs, w_hit, w_short, w_max, w_rand, sigma, rate, zmax):
    z, zs = z.astype(np.float32), zs.astype(np.float32)
    hit = np.exp(-((z - zs) ** 2) / np.float32(2 * sigma**2)) / np.float32(sigma * (2 * np.pi) ** 0.5)
    hit /= (ndtr((zmax - zs) / sigma) - ndtr(-zs / sigma)).astype(np.float32)
    short = (z <= zs) * rate * np.exp(-rate * z) / -np.expm1(-rate * zs)
    nothing = z >= zmax
    return w_hit * hit + w_short * short + np.where(nothing, w_max, w_rand / zmax)
