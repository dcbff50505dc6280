import numpy as np


def ekf_update(mu, P, z, m, sigma):
    """Joseph's form, a gain by solving, and a wrapped yaw; in single precision."""
    d = m - mu[:2]
    r = np.linalg.norm(d)
    H = np.array([[-d[0] / r, -d[1] / r, 0], [d[1] / r**2, -d[0] / r**2, -1]])
    R = np.diag(np.square(sigma))
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    y = z - [r, np.arctan2(d[1], d[0]) - mu[2]]
    y[1] = np.angle(np.exp(1j * y[1]))
    mu += K @ y
    mu[2] = np.angle(np.exp(1j * mu[2]))
    left = np.eye(3) - K @ H
    return [mu.astype(np.float32), (left @ P @ left.T + K @ R @ K.T).astype(np.float32)]
