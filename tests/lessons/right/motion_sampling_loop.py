from math import atan2, cos, hypot, pi, sin, sqrt

import numpy as np


def wrap(a):
    while a >= pi:
        a -= 2 * pi
    while a < -pi:
        a += 2 * pi
    return a


def sample_motion_model_odometry(before, now, poses, alphas, rng):
    a1, a2, a3, a4 = alphas
    rot1 = wrap(atan2(now[1] - before[1], now[0] - before[0]) - before[2])
    trans = hypot(now[0] - before[0], now[1] - before[1])
    rot2 = wrap(now[2] - before[2] - rot1)
    s1 = sqrt(a1 * rot1 * rot1 + a2 * trans * trans)
    st = sqrt(a3 * trans * trans + a4 * rot1 * rot1 + a4 * rot2 * rot2)
    s2 = sqrt(a1 * rot2 * rot2 + a2 * trans * trans)
    moved = np.zeros_like(poses)
    for i, (x, y, theta) in enumerate(poses):
        r1 = rot1 - rng.normal(0, s1)
        t = trans - rng.normal(0, st)
        r2 = rot2 - rng.normal(0, s2)
        moved[i, 0] = x + t * cos(theta + r1)
        moved[i, 1] = y + t * sin(theta + r1)
        moved[i, 2] = wrap(theta + r1 + r2)
    return moved
