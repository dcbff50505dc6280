"""What a drive consists of, found in anybody's recording: scans, odometry, and the laser's place on the robot."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.logs import schema
from pipeline.logs.choice import SCAN_TYPES, candidates, chosen, find, of_robot
from pipeline.logs.columns import GyroscopeColumns, PoseColumns, ScanColumns
from pipeline.logs.decode import decode_scans
from pipeline.logs.gyroscope import collect_gyroscope
from pipeline.logs.odometry import joined, without_strays
from pipeline.logs.recorded import ByLogTime, Names, Recorded, describe, shortened
from pipeline.logs.stretches import Clock, alongside, one_time, told
from pipeline.logs.transforms import Transforms, in_space
from pipeline.logs.two_lasers import merged
from pipeline.logs.which_odometry import find_odometry

_STANDS_OUT = 10
"""So many times as often as readings just below it must the longest range occur to mean that nothing came back."""
_FARTHEST_READING = np.float32(1000.0)
"""m: a longest range above that was never filled in."""
FARTHEST_MOUNT = 50.0
"""m: a laser that far from the robot's centre is on no robot."""


@dataclass(frozen=True)
class Drive:
    """Scans and odometry as recorded, ``laser_in_base`` (4, 4), and the topics and frames that they are from.

    ``odometry`` and ``gyroscope`` are None where the recording has none. All stamps are those of ``clock``, in which
    every stretch follows the one before; ``remarks``: what a user should know of how the recording was read.
    """

    scans: ScanColumns
    odometry: PoseColumns | None
    laser_in_base: NDArray[np.float64]
    origin: dict[str, str]
    gyroscope: GyroscopeColumns | None = None
    clock: Clock = field(default_factory=lambda: Clock(np.zeros(1, np.int64), np.zeros(1, np.int64)))
    remarks: tuple[str, ...] = ()


def collect(recorded: Recorded, names: Names | None = None, *, mend: bool = True) -> Drive:
    """Scans, odometry and the laser's place: where ``names`` does not say it, by their types and by the transforms.

    Odometry is a topic of Odometry messages, else odom -> base among the transforms. Without either, and unless
    ``names`` asks for it, there is none: then the robot's centre is the root of the transforms that carry the laser, or
    the laser itself in a recording without transforms. A gyroscope is a topic of Imu messages. Of several lasers the
    first is taken with which all this is found. ``mend``: odometry that jumps there and back is left out, and such as
    never moves is not taken. Raises MclError if the scans, odometry that was asked for, or the laser's place are
    missing, and says what the recording has instead.
    """
    names = names or Names()
    if names.stamps == "log":
        recorded = ByLogTime(recorded)
    try:
        return _collect(recorded, names, mend)
    except MclError as error:
        hint = error.hint or "; ".join(recorded.remarks)
        raise MclError(error.message, hint, path=error.path or recorded.path, line=error.line) from error


def mark_no_return(scans: ScanColumns) -> ScanColumns:
    """The scans with a longest range that is a number and above which nothing came back.

    Simulators and older drivers say "nothing" by a reading of exactly the longest range, where REP 117 has infinity:
    if that stands out among the readings just below it, the longest range becomes the next smaller number. If a
    driver never filled in the longest range, it is the longest reading.
    """
    finite = scans.ranges[scans.ranges <= _FARTHEST_READING]
    longest = np.float32(scans.range_max)
    if not (longest <= _FARTHEST_READING and longest > max(scans.range_min, 0.0)):
        longest = finite.max(initial=np.float32(0.0))
        return replace(scans, range_max=float(longest)) if longest > 0 else scans
    at_the_end = int(np.count_nonzero(finite == longest))
    below = int(np.count_nonzero((finite < longest) & (finite >= longest * np.float32(0.99))))
    if at_the_end > _STANDS_OUT * max(below, len(scans) / 100):
        return replace(scans, range_max=float(np.nextafter(longest, np.float32(0.0))))
    return scans


def _collect(recorded: Recorded, names: Names, mend: bool) -> Drive:
    if names.scan_topic and "," in names.scan_topic:
        return _by_all(recorded, [topic.strip() for topic in names.scan_topic.split(",")], names, mend)
    asked = chosen(recorded, names.scan_topic, SCAN_TYPES)
    topics = [asked] if asked else candidates(recorded, *SCAN_TYPES)
    if not topics:
        clouds = any(topic.type == schema.CLOUD_TYPE for topic in recorded.topics.values())
        raise MclError(
            f"no laser scans ({schema.LASER_SCAN_TYPE}) in this file: {describe(recorded.topics)}",
            "ROS's pointcloud_to_laserscan makes scans of the point clouds" if clouds else "",
        )
    refused: list[tuple[str, MclError]] = []
    for topic in topics:
        try:
            drive = _drive(recorded, topic, names, mend)
        except MclError as error:
            refused.append((topic, error))
            continue
        remarks = [f"{name} was not taken: {error.message}" for name, error in refused]
        if rest := [f"{t} ({recorded.topics[t].count:,})" for t in topics[len(refused) + 1 :]]:
            remarks.append(f"{topic} is taken, and not {shortened(rest, 'topics')}; --scan-topic takes another")
        return replace(drive, remarks=(*recorded.remarks, *remarks, *drive.remarks))
    raise refused[0][1]


def _by_all(recorded: Recorded, topics: list[str], names: Names, mend: bool) -> Drive:
    """The drive by the scans of several lasers of one robot, as if one laser at its centre had taken them."""
    if names.laser_pose is not None or names.laser_frame is not None:
        raise MclError("--laser-pose and --laser-frame are of one laser", "of several the transforms say the place")
    drives = [_collect(recorded, replace(names, scan_topic=topic), mend) for topic in topics]
    first = drives[0]
    bases = [drive.origin["frames"].split(" -> ")[1] for drive in drives]
    for topic, base in zip(topics, bases, strict=True):
        if base != bases[0]:
            raise MclError(f"{topic} is on {base!r}, {topics[0]} on {bases[0]!r}", "--base-frame chooses the robot's")
    if any(len(drive.clock.begins) > 1 for drive in drives):
        raise MclError("stamps begin anew in this recording", "its lasers are read one at a time: --scan-topic TOPIC")
    lasers = [(cleaned(mark_no_return(drive.scans)), drive.laser_in_base) for drive in drives]
    scans = merged(lasers, first.odometry, bases[0])
    frames = " -> ".join([*first.origin["frames"].split(" -> ")[:2], bases[0]])
    origin = first.origin | {"frames": frames, "lasers": ", ".join(topics)}
    remarks = [remark for drive in drives for remark in drive.remarks if "--scan-topic takes another" not in remark]
    told = f"{' and '.join(topics)} are taken together, as one laser at {bases[0]!r}"
    return replace(
        first, scans=scans, laser_in_base=np.eye(4), origin=origin, remarks=tuple(dict.fromkeys([told, *remarks]))
    )


def cleaned(scans: ScanColumns) -> ScanColumns:
    """The scans after REP 117: NaN where invalid, inf where nothing came back."""
    low, high = np.float32(scans.range_min), np.float32(scans.range_max)
    with np.errstate(invalid="ignore"):
        ranges = np.where(scans.ranges > high, np.float32(np.inf), scans.ranges)
        return replace(scans, ranges=np.where((ranges <= 0) | (ranges < low), np.float32(np.nan), ranges))


def _drive(recorded: Recorded, scan_topic: str, names: Names, mend: bool) -> Drive:
    """The drive by the scans of one topic."""
    kinds = (schema.ODOMETRY_TYPE, schema.TF_TYPE)
    odom_topic = chosen(recorded, names.odom_topic, kinds)
    odom_topics = [odom_topic] if odom_topic else candidates(recorded, schema.ODOMETRY_TYPE, beside=scan_topic)
    messages = recorded.messages({scan_topic, *odom_topics[:1]})
    scans = decode_scans(messages[scan_topic], names.laser_frame)
    laser = (names.laser_frame or scans.frame).lstrip("/")
    said = [t.name for t in recorded.topics.values() if t.type == schema.TF_TYPE]
    transforms = Transforms(recorded, of_robot(recorded, scan_topic, said), names.transforms)
    found = find_odometry(recorded, odom_topics, messages, transforms, names, scans, laser, mend)
    odometry, odom, base = found.odometry, found.odom, found.base
    if not base:  # nobody says which frame is the robot's
        base = names.base_frame or transforms.root(laser)
        alone = base == laser and not names.base_frame and names.laser_pose is None
        if alone and transforms and not transforms.knows(laser):
            raise _unplaced("the robot", laser, transforms)
    laser_in_base = transforms.place(laser, base, odom) if names.laser_pose is None else in_space(names.laser_pose)
    if laser_in_base is None:
        raise _unplaced(repr(base), laser, transforms)
    if (far := float(np.abs(laser_in_base[:3, 3]).max())) > FARTHEST_MOUNT:
        raise MclError(f"the laser {laser!r} is {far:g} m from {base!r}", "--laser-pose says where it is")
    imu_topic = find(recorded, schema.IMU_TYPE, beside=scan_topic)
    gyroscope, about_gyroscope = collect_gyroscope(recorded, imu_topic, transforms, base, odom)
    origin = {
        "scan_topic": scan_topic,
        "odometry_topic": "" if odometry is None else found.topic,
        "frames": f"{odom} -> {base} -> {laser}",
        "scans_resampled": str(scans.resampled),
        **about_gyroscope,
    }
    if odometry is None and not transforms and names.laser_pose is None:
        origin["laser_at_centre"] = "no transform says where it is"
    about_place = transforms.remarks(laser, base) if names.laser_pose is None else []
    remarks = [*scans.remarks, *found.remarks, *about_place]
    if others := [t for t in odom_topics if found.topic in odom_topics and t != found.topic and not found.remarks]:
        remarks.append(
            f"{found.topic} is the odometry, and not {shortened(others, 'topics')}; --odom-topic takes another"
        )
    clock, scans, odometry, gyroscope = _in_one_time(scan_topic, scans, odometry, gyroscope, remarks)
    if odometry is not None:
        _check_clocks(scans.stamps, odometry.stamps)
        odometry = _in_one_frame(odometry, found.topic if mend else "", remarks)
    return Drive(scans, odometry, laser_in_base, origin, gyroscope, clock, tuple(dict.fromkeys(remarks)))


def _in_one_time(
    scan_topic: str,
    scans: ScanColumns,
    odometry: PoseColumns | None,
    gyroscope: GyroscopeColumns | None,
    remarks: list[str],
) -> tuple[Clock, ScanColumns, PoseColumns | None, GyroscopeColumns | None]:
    """All of it by one clock."""
    odometry = None if odometry is None else alongside(scans, odometry)
    gyroscope = None if gyroscope is None else alongside(scans, gyroscope)
    clock = one_time(scans, odometry, gyroscope)
    if scans.stretch is not None:
        remarks.append(told(scan_topic, scans.stamps, scans.stretch, clock))
    if gyroscope is not None:
        gyroscope = clock(gyroscope)
        gyroscope = gyroscope.take(np.argsort(gyroscope.stamps, kind="stable"))
    return clock, clock(scans), None if odometry is None else clock(odometry), gyroscope


def _check_clocks(scans: NDArray[np.int64], odometry: NDArray[np.int64]) -> None:
    first, last = odometry.min(), odometry.max()
    if not ((scans >= first) & (scans <= last)).any():
        raise MclError(
            f"no scan lies within the odometry's time span: scans {_span(scans)}, odometry {_span(odometry)}",
            "two clocks? then --stamps log takes when they were written down",
        )


def _span(stamps: NDArray[np.int64]) -> str:
    return f"from {stamps.min() / 1e9:.3f} to {stamps.max() / 1e9:.3f} s"


def _in_one_frame(odometry: PoseColumns, mended: str, remarks: list[str]) -> PoseColumns:
    """The odometry as it goes on from one stretch to the next; without strays if its topic is ``mended``."""
    ordered = odometry.take(np.argsort(odometry.stamps, kind="stable"))
    sound = without_strays(ordered, mended) if mended else ordered
    remarks += sound.remarks[len(ordered.remarks) :]
    whole = joined(sound)
    return odometry if whole is ordered else whole


def _unplaced(base: str, laser: str, transforms: Transforms) -> MclError:
    remarks = "".join(f"; {said}" for said in transforms.remarks(laser, base.strip("'")))
    return MclError(
        f"no transform from {base} to the laser {laser!r}: {transforms.describe()}{remarks}",
        "--laser-pose X,Y,YAW says where it is, or --tf FILE; --base-frame and --laser-frame choose other frames",
    )
