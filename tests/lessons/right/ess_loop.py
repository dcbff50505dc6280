import math


def effective_sample_size(log_weights):
    largest = max(log_weights)
    weights = [math.exp(value - largest) for value in log_weights]
    total = sum(weights)
    squares = 0.0
    for weight in weights:
        squares += (weight / total) ** 2
    return 1 / squares
