"""As the book has it, counted from 0."""


def low_variance_sampler(weights, rng):
    n = len(weights)
    survivors = []
    start = rng.random() / n
    total = weights[0]
    i = 0
    for m in range(n):
        tooth = start + m / n
        while tooth > total and i < n - 1:
            i = i + 1
            total = total + weights[i]
        survivors.append(i)
    return survivors
