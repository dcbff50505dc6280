import math


def normal(x, variance):
    return math.exp(-(x**2) / (2 * variance)) / math.sqrt(2 * math.pi * variance)


def wrap(angle):
    return math.atan2(math.sin(angle), math.cos(angle))


def taken_apart(a, b):
    rot1 = wrap(math.atan2(b[1] - a[1], b[0] - a[0]) - a[2])
    trans = math.hypot(b[0] - a[0], b[1] - a[1])
    rot2 = wrap(b[2] - a[2] - rot1)
    return rot1, trans, rot2


def motion_model_odometry(moved, poses, before, now, alphas):
    a1, a2, a3, a4 = alphas
    rot1, trans, rot2 = taken_apart(before, now)
    densities = []
    for pose, target in zip(poses, moved, strict=True):
        hat1, hat_trans, hat2 = taken_apart(pose, target)
        p1 = normal(wrap(rot1 - hat1), a1 * hat1**2 + a2 * hat_trans**2)
        p2 = normal(trans - hat_trans, a3 * hat_trans**2 + a4 * (hat1**2 + hat2**2))
        p3 = normal(wrap(rot2 - hat2), a1 * hat2**2 + a2 * hat_trans**2)
        densities.append(p1 * p2 * p3)
    return densities
