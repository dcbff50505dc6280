import numpy as np

TURN = 2 * np.pi


def motion_model_odometry(after, poses, odom0, odom1, alphas):
    """With complex numbers for places and turns, in single precision at the end; by logarithms."""

    def split(start, end):
        way = (end[..., 0] - start[..., 0]) + 1j * (end[..., 1] - start[..., 1])
        first = np.angle(way * np.exp(-1j * start[..., 2]))
        second = np.angle(np.exp(1j * (end[..., 2] - start[..., 2] - first)))
        return np.stack([first, abs(way), second], axis=-1)

    said, asked = split(odom0, odom1), split(poses, after)
    turns = asked[:, [0, 2]] ** 2
    square = asked[:, 1] ** 2
    variance = np.stack(
        [
            alphas[0] * turns[:, 0] + alphas[1] * square,
            alphas[2] * square + alphas[3] * turns.sum(axis=1),
            alphas[0] * turns[:, 1] + alphas[1] * square,
        ],
        axis=-1,
    ).astype(np.float32)
    off = said - asked
    off[:, [0, 2]] -= TURN * np.round(off[:, [0, 2]] / TURN)
    logs = -0.5 * off.astype(np.float32) ** 2 / variance - 0.5 * np.log(np.float32(TURN) * variance)
    return np.exp(logs.sum(axis=1))
