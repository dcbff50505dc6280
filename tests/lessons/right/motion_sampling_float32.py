import numpy as np


def sample_motion_model_odometry(u0, u1, particles, alphas, rng):
    """All noise at once, added where the reference subtracts it; the caller's arrays are changed on the way."""
    delta = u1 - u0
    angle = np.arctan2(delta[1], delta[0])
    turn1 = (angle - u0[2] + np.pi) % (2 * np.pi) - np.pi
    turn2 = (delta[2] - turn1 + np.pi) % (2 * np.pi) - np.pi
    drive = np.sqrt(delta[0] ** 2 + delta[1] ** 2)
    squares = np.array([turn1**2, drive**2, turn2**2])
    mixing = np.array([[alphas[0], alphas[1], 0], [alphas[3], alphas[2], alphas[3]], [0, alphas[1], alphas[0]]])
    noise = rng.standard_normal((len(particles), 3)).astype(np.float32) * np.sqrt(mixing @ squares).astype(np.float32)
    parts = noise + np.array([turn1, drive, turn2], np.float32)
    particles[:, 2] += parts[:, 0]
    particles[:, 0] += parts[:, 1] * np.cos(particles[:, 2])
    particles[:, 1] += parts[:, 1] * np.sin(particles[:, 2])
    particles[:, 2] += parts[:, 2]
    return particles.astype(np.float32)
