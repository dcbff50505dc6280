"""Logs with faults made in them: a log in memory, or the columns of one that is about to be written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.geometry import between
from pipeline.logs import schema
from pipeline.logs.columns import GyroscopeColumns, PoseColumns, ScanColumns, planar_poses
from pipeline.logs.faults import KINDS, Fault, changed, note, noted, placed, reckoned, recorded, scanned, told, wrapped
from pipeline.logs.messages import Log

Array = NDArray[np.float64]
Rows = NDArray[np.int64]


def disturbed(log: Log, faults: Sequence[Fault]) -> tuple[Log, Rows]:
    """The log as it would be with these faults, ``placed``, and which (n,) of its scans each of the scans is.

    A jump comes first: then the moments of the others are those of the log that it makes. What is true of a scan is
    true of it wherever it stands; the log's own ground truth, which goes by time, is left out where scans have moved.
    Raises MclError for a fault of wheels that the log does not have.
    """
    _check(faults, log.wheels)
    jumps = sorted((fault for fault in faults if fault.kind == "jump"), key=lambda fault: fault.begin)
    rows, stamps, anew = _resequenced(log, jumps)
    times = (stamps - stamps[0]) / 1e9
    odometry = log.odometry[rows]
    if anew:
        steps = between(odometry[:-1], odometry[1:])
        standing = steps.copy()
        standing[np.array(anew) - 1] = 0.0
        odometry = reckoned(odometry, steps, standing)
    sweeps = None if log.sweeps is None else log.sweeps[rows]
    kept = np.arange(len(rows))
    for fault in faults:
        if log.wheels:
            odometry = told(fault, times, odometry)
            sweeps = None if sweeps is None else _swept(fault, log, times, sweeps)
        kept = kept[scanned(fault, times[kept])]
        if not recorded(fault, times).all():
            anew.append(int(np.searchsorted(times, fault.args[1], side="right")))
    turns = None if log.turns is None else log.turns[rows]
    if turns is not None:
        turns[[k for k in anew if k < len(turns)]] = np.nan  # nobody heard how far it was turned meanwhile
    made = replace(
        log,
        stamps=stamps[kept],
        odometry=wrapped(odometry)[kept] if log.wheels else odometry[kept],
        ranges=log.ranges[rows[kept]],
        ground_truth=None if jumps else log.ground_truth,
        metadata={**log.metadata, schema.FAULTS: note((*noted(log.metadata), *faults))},
        sweeps=None if sweeps is None else sweeps[kept],
        turns=None if turns is None else turns[kept],
        stretches=None if log.stretches is None else log.stretches[rows[kept]],
    )
    return made, rows[kept]


def disturbed_columns(
    scans: ScanColumns,
    odometry: PoseColumns | None,
    gyroscope: GyroscopeColumns | None,
    faults: Sequence[Fault],
    seed: int,
) -> tuple[ScanColumns, PoseColumns | None, GyroscopeColumns | None, tuple[Fault, ...]]:
    """What a converter is about to write, in the order of its stamps, with the faults made, and where they were placed.

    Raises MclError for faults that need what is not there, and for a jump, which only a log in memory can make.
    """
    _check(faults, odometry is not None)
    start = int(scans.stamps[0])
    made = placed(faults, float(scans.stamps[-1] - start) / 1e9, seed)
    for fault in made:
        if fault.kind == "jump":
            raise MclError("a jump sets scans of another time behind each other: only mcl evaluate can make it")
        if odometry is not None:
            times, poses = (odometry.stamps - start) / 1e9, odometry.planar
            if (new := told(fault, times, poses)) is not poses:
                where = odometry.frame, odometry.child_frame
                odometry = planar_poses(odometry.stamps, odometry.sequences, wrapped(new), *where)
            odometry = odometry.take(recorded(fault, times))
        keep = scanned(fault, (scans.stamps - start) / 1e9)
        scans = replace(scans, stamps=scans.stamps[keep], sequences=scans.sequences[keep], ranges=scans.ranges[keep])
        if gyroscope is not None:
            keep = recorded(fault, (gyroscope.stamps - start) / 1e9)
            gyroscope = replace(gyroscope, stamps=gyroscope.stamps[keep], rates=gyroscope.rates[keep])
    return scans, odometry, gyroscope, made


def _check(faults: Sequence[Fault], wheels: bool) -> None:
    for fault in faults:
        if KINDS[fault.kind].wheels and not wheels:
            raise MclError(f"fault {fault.name}: the log has no odometry that could be wrong")


def _resequenced(log: Log, jumps: Sequence[Fault]) -> tuple[Rows, NDArray[np.int64], list[int]]:
    """The scans in the order in which a robot that is put elsewhere makes them: which each is, its stamp, the joints.

    The scan after a jump is made when the one was that it replaces. The log gets no longer than it was.
    """
    rows, stamps, joints = np.arange(len(log)), log.stamps, []
    for jump in jumps:
        cut = int(np.searchsorted((stamps - stamps[0]) / 1e9, jump.args[0]))
        to = int(np.searchsorted(log.times, jump.args[1]))
        if not (0 < cut < len(rows) and to < len(log)):
            raise MclError(f"fault {jump.text}: the log runs from 0 to {log.duration:.1f} s")
        later = log.stamps[to:] + (stamps[cut] - log.stamps[to])
        later = later[later <= log.stamps[-1]]
        rows = np.concatenate([rows[:cut], np.arange(to, to + len(later))])
        stamps = np.concatenate([stamps[:cut], later])
        joints.append(cut)
    return rows, stamps, joints


def _swept(fault: Fault, log: Log, times: Array, sweeps: Array) -> Array:
    """How such wheels say that the robot moved while each scan was measured, (n, 3)."""
    if fault.kind == "late":
        then = times - fault.args[0]
        return np.stack([np.interp(then, times, column) for column in sweeps.T], axis=-1)
    seconds = (log.laser.beams - 1) * abs(log.laser.time_increment)
    return changed(fault, sweeps, times, times + seconds)
