"""Odometry at the stamps of scans: without messages that are wrong, and in one frame where stamps begin anew.

Where it leaps and stays away, as after a restart, it is handed on as it was recorded: ``pipeline.motion`` notices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.geometry import Pose, between, compose, inverse, wrap_angle
from pipeline.logs.columns import PoseColumns, planar_poses
from pipeline.logs.leaps import leapt

EXCURSION = 5
"""So many messages may be elsewhere and the next one back again: they are wrong, and the odometry did not leap."""


def without_strays(odometry: PoseColumns, what: str) -> PoseColumns:
    """Odometry, in the order of its stamps, without messages that leap elsewhere and back; ``remarks`` say so.

    ``what`` names the topic in the remark. Where a stretch begins nothing has leapt.
    """
    times, planar = odometry.stamps / 1e9, odometry.planar
    leaps = leapt(between(planar[:-1], planar[1:]), np.diff(times))
    if odometry.stretch is not None:
        leaps &= np.diff(odometry.stretch) == 0
    wrong: list[int] = []
    for start in (np.flatnonzero(leaps) + 1).tolist():
        if wrong and start <= wrong[-1] + 1:
            continue
        for back in range(start + 1, min(start + 1 + EXCURSION, len(planar))):
            if odometry.stretch is not None and odometry.stretch[back] != odometry.stretch[start]:
                break
            if leaps[back - 1] and not leapt(between(planar[start - 1], planar[back]), times[back] - times[start - 1]):
                wrong += range(start, back)
                break
    if not wrong:
        return odometry
    x, y, _ = planar[wrong[0]]
    remark = (
        f"{what}: {len(wrong):,} of {len(planar):,} messages left out, no robot gets there and back so fast: the "
        f"first says x = {x:g}, y = {y:g}"
    )
    return replace(odometry.take(np.delete(np.arange(len(planar)), wrong)), remarks=(*odometry.remarks, remark))


def joined(odometry: PoseColumns) -> PoseColumns:
    """Odometry, in the order of its stamps, that goes on from where it stood where a stretch begins."""
    begins = [] if odometry.stretch is None else (np.flatnonzero(np.diff(odometry.stretch)) + 1).tolist()
    if not begins:
        return odometry
    whole = gone_on(odometry.planar, begins)
    moved = planar_poses(odometry.stamps, odometry.sequences, whole, odometry.frame, odometry.child_frame)
    return replace(moved, stretch=odometry.stretch, remarks=odometry.remarks)


def gone_on(poses: NDArray[np.float64], begins: Sequence[int]) -> NDArray[np.float64]:
    """Poses (n, 3) that stand still before each of the rows ``begins``, whatever they say there, and go on."""
    starts = [0, *begins]
    ends, motions = [*starts[1:], len(poses)], continue_odometry(poses, starts)
    whole = np.concatenate([move(poses[s:e], m) for s, e, m in zip(starts, ends, motions, strict=True)])
    whole[:, 2] = wrap_angle(whole[:, 2])
    return whole


def continue_odometry(poses: NDArray[np.float64], starts: Sequence[int]) -> list[Pose]:
    """For every stretch, given by the index of its first pose, the motion that lets it go on from the one before.

    ``poses`` (n, 3) m, m, rad as in the source; ``starts`` begins with 0. The first motion is the identity.
    """
    motions: list[Pose] = [(0.0, 0.0, 0.0)]
    for start in starts[1:]:
        last = compose(motions[-1], poses[start - 1])
        x, y, yaw = compose(last, inverse(poses[start])).tolist()
        motions.append((x, y, yaw))
    return motions


def move(poses: NDArray[np.float64], motion: Pose) -> NDArray[np.float64]:
    """motion (+) poses (n, 3), turns kept; the identity gives the same numbers back to the last bit."""
    if motion == (0.0, 0.0, 0.0):
        return poses
    x, y, yaw = motion
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.column_stack(
        [
            x + cos * poses[:, 0] - sin * poses[:, 1],
            y + sin * poses[:, 0] + cos * poses[:, 1],
            poses[:, 2] + yaw,
        ]
    )


def odometry_at(
    stamps: NDArray[np.int64], sequences: NDArray[np.int64], odometry: PoseColumns
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Poses (n, 3) at the scans' stamps, and which of the scans lie within the odometry's span.

    Where it leaps, the message before counts until the next one: nobody was half-way there.
    """
    order = np.argsort(odometry.stamps, kind="stable")
    times, poses, numbers = odometry.stamps[order], odometry.planar[order], odometry.sequences[order]
    left, right = np.searchsorted(times, stamps, "left"), np.searchsorted(times, stamps, "right")
    inside = (stamps >= times[0]) & (stamps <= times[-1])
    before, after = np.clip(right - 1, 0, None), np.clip(right, None, len(times) - 1)
    exact = right > left
    share = (stamps - times[before]) / np.maximum(times[after] - times[before], 1)
    share[exact] = 0.0
    for i in np.flatnonzero(right - left > 1):
        same = np.flatnonzero(numbers[left[i] : right[i]] == sequences[i])
        if len(same):
            before[i] = left[i] + same[0]
    step = poses[after] - poses[before]
    step[:, 2] = wrap_angle(step[:, 2])
    share[leapt(step, (times[after] - times[before]) / 1e9)] = 0.0
    result = poses[before] + share[:, None] * step
    result[~exact, 2] = wrap_angle(result[~exact, 2])
    return result, inside
