import math

import numpy as np


def ekf_update(mean, covariance, z, landmark, deviations):
    dx = landmark[0] - mean[0]
    dy = landmark[1] - mean[1]
    q = dx * dx + dy * dy
    root = math.sqrt(q)
    expected_range = root
    expected_bearing = math.atan2(dy, dx) - mean[2]
    H = np.array([[-dx / root, -dy / root, 0.0], [dy / q, -dx / q, -1.0]])
    Q = np.array([[deviations[0] ** 2, 0.0], [0.0, deviations[1] ** 2]])
    S = H.dot(covariance).dot(H.T) + Q
    K = covariance.dot(H.T).dot(np.linalg.inv(S))
    bearing = z[1] - expected_bearing
    bearing = math.atan2(math.sin(bearing), math.cos(bearing))
    mean = mean + K.dot(np.array([z[0] - expected_range, bearing]))
    covariance = (np.eye(3) - K.dot(H)).dot(covariance)
    return mean, covariance
