"""What is odd about a recording as a whole: its container, its robots, its tree of frames."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from converters.bag_file import METADATA, metadata
from converters.text import read_log_bytes
from pipeline.check.findings import NOTHING, Finding
from pipeline.errors import MclError
from pipeline.logs import schema
from pipeline.logs.choice import SCAN_TYPES, readable
from pipeline.logs.decode import typestore
from pipeline.logs.recorded import Recorded, shortened

LOOKED_AT = 1000
"""Messages of each topic of transforms that are looked at: whoever publishes two parents does so from the start."""
COMMENTS = (b"#", b"%", b"//")
STORAGES = ("mcap", "sqlite3")


def findings_of_container(path: Path, recorded: Recorded) -> Iterator[Finding]:
    """What a user may not know of a bag or an .mcap, though it is read all the same."""
    if path.is_dir():
        yield from _metadata(path)
    if ros1 := getattr(recorded, "ros1_topics", ()):
        yield Finding("noted", "file", f"The messages are ROS 1's ({shortened(ros1, 'topics')}).", NOTHING)
    scans = [t for t in recorded.topics.values() if t.type in SCAN_TYPES and readable(t)]
    several = [t.name for t in scans if t.type == schema.MULTI_ECHO_TYPE]
    if several:
        text = f"{shortened(several, 'topics')} has several echoes for each beam: the first, nearest one counts."
        yield Finding("noted", "laser", text, NOTHING)
    robots = sorted({t.name.split("/")[1] for t in scans if t.name.count("/") > 1})
    odometries = [t.name for t in recorded.topics.values() if t.type == schema.ODOMETRY_TYPE]
    driven = [robot for robot in robots if any(name.startswith(f"/{robot}/") for name in odometries)]
    if len(driven) > 1:
        yield Finding(
            "doubtful", "topics", f"Several robots are in this recording: {shortened(driven, 'robots')}.",
            "--scan-topic chooses one by its laser; its odometry and transforms come with it.",
        )  # fmt: skip
    yield from _frames(recorded)


def findings_of_text(path: Path) -> Iterator[Finding]:
    """What a user may not know of a raw text log, though it is read all the same."""
    if path.is_dir():
        return
    data, _ = read_log_bytes(path)
    comments = sum(line.lstrip().startswith(COMMENTS) for line in data.split(b"\n"))
    if comments:
        lines = "1 line is a comment" if comments == 1 else f"{comments:,} lines are comments"
        yield Finding("noted", "file", f"{lines}, and skipped.", NOTHING)


def _metadata(folder: Path) -> Iterator[Finding]:
    do = "ros2 bag reindex writes it anew; the files themselves are believed here."
    if not (folder / METADATA).is_file():
        yield Finding("noted", "file", f"The bag has no {METADATA}.", do)
    elif (storage := metadata(folder).get("storage_identifier")) is None:
        yield Finding("noted", "file", f"{METADATA} cannot be read.", do)
    elif storage not in STORAGES:
        yield Finding("noted", "file", f"{METADATA} calls the bag's storage {storage!r}.", do)


def _frames(recorded: Recorded) -> Iterator[Finding]:
    parents: dict[str, list[str]] = {}
    for topic in recorded.topics.values():
        if topic.type != schema.TF_TYPE or not readable(topic) or topic.name in schema.VIEW_TRANSFORMS:
            continue
        try:
            said = recorded.messages([topic.name])[topic.name]
            for data in said.data[:LOOKED_AT]:
                for item in typestore().deserialize_cdr(data, topic.type).transforms:
                    parent, child = item.header.frame_id.lstrip("/"), item.child_frame_id.lstrip("/")
                    if parent not in (above := parents.setdefault(child, [])):
                        above.append(parent)
        except MclError:
            continue
        except Exception:  # a message that is none: the reader says what it did about it
            continue
    for child, above in parents.items():
        if len(above) > 1:
            yield Finding(
                "doubtful", "transforms", f"The frame {child} has several parents: {shortened(above, 'frames')}.",
                "A frame hangs from one parent. Two nodes publish it: stop one. The first that is said counts.",
            )  # fmt: skip
        elif "odom" in child.lower() and not any(word in above[0].lower() for word in ("map", "world", "odom")):
            yield Finding(
                "noted", "transforms", f"The transforms say {above[0]} -> {child}, the odometry the wrong way round.",
                "Nothing, while there is a topic of odometry.",
            )  # fmt: skip
