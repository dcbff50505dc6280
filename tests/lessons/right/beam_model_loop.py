import math


def below(x):
    return 0.5 * (1.0 + math.erf(x / math.sqrt(2.0)))


def beam_range_finder_model(z, z_star, z_hit, z_short, z_max, z_rand, sigma_hit, lambda_short, max_range):
    result = []
    for measured, true in zip(z, z_star, strict=True):
        eta = 1.0 / (below((max_range - true) / sigma_hit) - below((0.0 - true) / sigma_hit))
        variance = sigma_hit**2
        p_hit = eta / math.sqrt(2.0 * math.pi * variance) * math.exp(-0.5 * (measured - true) ** 2 / variance)
        p_short = 0.0
        if measured <= true:
            eta = 1.0 / (1.0 - math.exp(-lambda_short * true))
            p_short = eta * lambda_short * math.exp(-lambda_short * measured)
        p_max = 1.0 if measured == max_range else 0.0
        p_rand = 1.0 / max_range if measured < max_range else 0.0
        result.append(z_hit * p_hit + z_short * p_short + z_max * p_max + z_rand * p_rand)
    return result
