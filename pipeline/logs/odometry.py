"""Odometry at the stamps of scans, and in one piece: where it was reset it goes on from where it stood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.geometry import Pose, compose, inverse, wrap_angle
from pipeline.logs.columns import PoseColumns, planar_poses

LEAP, TURN = 0.5, 0.5
"""m, rad: a smaller step is no jump, however short it took."""
FASTEST, TURNING = 2.0, 8.0
"""m/s, rad/s: every robot may be as fast as that; real wheels slipped at 6.6 rad/s."""
TIMES_USUAL = 4.0
"""So many times the speed that nine of ten steps stay below is a jump."""
ZERO = 0.02
"""m, rad: who lands so near to the origin from afar was set back to it."""
SHORTEST = 0.02
"""s: two stamps closer together say nothing of a speed."""
EXCURSION = 5
"""So many messages may be elsewhere and the next one back again, without a reset: they are wrong."""


def in_one_piece(odometry: PoseColumns, what: str, breaks: Sequence[int] = ()) -> PoseColumns:
    """Odometry, in the order of its stamps, that does not jump: after a jump that no robot makes it goes on from where
    it stood, and messages that jump there and back are left out; ``remarks`` say so.

    ``breaks``: rows before which it was begun anew for another reason, which are no jumps and no drives either.
    """
    planar = odometry.planar
    jumping = _jumps(odometry.stamps, planar)
    jumping[list(breaks)] = False
    if not jumping.any() and not breaks:
        return odometry
    kept, resets, wrong = _walked(odometry.stamps, planar, jumping, set(breaks))
    remarks = odometry.remarks
    if wrong:
        x, y, _ = planar[wrong[0]]
        remarks += (
            f"{what}: {len(wrong):,} of {len(planar):,} messages left out, no robot gets there and back so fast: the "
            f"first says x = {x:g}, y = {y:g}",
        )
    if resets:
        at = resets[0]
        far = np.hypot(*(planar[at] - planar[at - 1])[:2])
        seconds = (odometry.stamps[at] - odometry.stamps[at - 1]) / 1e9
        times = "once" if len(resets) == 1 else f"{len(resets):,} times"
        since = (odometry.stamps[at] - odometry.stamps[0]) / 1e9
        remarks += (
            f"{what} was reset {times}, first {since:.1f} s after its start: {far:.1f} m in {seconds:.2f} s is no "
            "drive; it goes on from where it stood",
        )
    starts = np.searchsorted(kept, [0, *sorted({*resets, *breaks})]).tolist()
    rest = odometry.take(np.array(kept))
    motions = continue_odometry(rest.planar, starts)
    ends = [*starts[1:], len(rest)]
    whole = np.concatenate([move(rest.planar[s:e], m) for s, e, m in zip(starts, ends, motions, strict=True)])
    whole[:, 2] = wrap_angle(whole[:, 2])
    moved = planar_poses(rest.stamps, rest.sequences, whole, rest.frame, rest.child_frame)
    return replace(moved, stretch=rest.stretch, remarks=remarks)


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


def _walked(
    stamps: NDArray[np.int64], planar: NDArray[np.float64], jumping: NDArray[np.bool_], breaks: set[int]
) -> tuple[list[int], list[int], list[int]]:
    """The rows to keep, those of them that follow a reset, and those that are wrong."""
    usual = _usual(stamps, planar)
    kept = [0]
    resets: list[int] = []
    wrong: list[int] = []
    i = 1
    while i < len(planar):
        if i in breaks or not (jumping[i] if kept[-1] == i - 1 else _jump(stamps, planar, kept[-1], i, usual)):
            kept.append(i)
            i += 1
            continue
        ahead = range(i + 1, min(i + 1 + EXCURSION, len(planar)))
        back = next((j for j in ahead if not breaks & set(range(i, j + 1)) and jumping[j]), None)
        if back is not None and not _jump(stamps, planar, kept[-1], back, usual):
            wrong += range(i, back)
            kept.append(back)
            i = back + 1
        else:
            resets.append(i)
            kept.append(i)
            i += 1
    return kept, resets, wrong


def _usual(stamps: NDArray[np.int64], planar: NDArray[np.float64]) -> float:
    """The speed, m/s, that nine of ten steps stay below."""
    seconds = np.maximum(np.diff(stamps) / 1e9, SHORTEST)
    return float(np.percentile(np.hypot(*np.diff(planar[:, :2], axis=0).T) / seconds, 90)) if len(planar) > 1 else 0.0


def _jumps(stamps: NDArray[np.int64], planar: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether the robot cannot have driven from the pose before to each (n,)."""
    usual = _usual(stamps, planar)
    rows = np.arange(len(planar))
    return np.concatenate([[False], _jump(stamps, planar, rows[:-1], rows[1:], usual)])


def _jump(
    stamps: NDArray[np.int64],
    planar: NDArray[np.float64],
    before: int | NDArray[np.int64],
    after: int | NDArray[np.int64],
    usual: float,
) -> NDArray[np.bool_]:
    seconds = np.maximum((stamps[after] - stamps[before]) / 1e9, SHORTEST)
    step = planar[after] - planar[before]
    far, turned = np.hypot(step[..., 0], step[..., 1]), np.abs(wrap_angle(step[..., 2]))
    leaps = (far > LEAP) & (far > max(FASTEST, TIMES_USUAL * usual) * seconds)
    spins = (turned > TURN) & (turned > TURNING * seconds)
    home = (np.abs(planar[after]).max(axis=-1) < ZERO) & (far > LEAP) & (far > max(1.0, FASTEST * usual) * seconds)
    return np.asarray(leaps | spins | home)


def odometry_at(
    stamps: NDArray[np.int64], sequences: NDArray[np.int64], odometry: PoseColumns
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Poses (n, 3) at the scans' stamps, and which of the scans lie within the odometry's span."""
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
    result = poses[before] + share[:, None] * step
    result[~exact, 2] = wrap_angle(result[~exact, 2])
    return result, inside
