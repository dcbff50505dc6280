"""What a look at a log finds: sentences in three grades, each with what to do about it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal, get_args

from pipeline.errors import MclError

Grade = Literal["broken", "doubtful", "noted"]
GRADES: Final[tuple[Grade, ...]] = get_args(Grade)
NOTHING: Final = "Nothing."


@dataclass(frozen=True)
class Finding:
    """One thing that was found: its ``grade``, what it is ``about``, a sentence, and what to ``do``.

    *broken*: the log cannot be localized, or the result would be wrong; *doubtful*: look at it, the result may be
    worse; *noted*: good to know. ``span``: from when to when, in seconds since the first scan, None if it always is.
    """

    grade: Grade
    about: str
    text: str
    do: str
    span: tuple[float, float] | None = None

    def to_dict(self) -> dict[str, Any]:
        """As plain values."""
        return asdict(self)


def worst_first(findings: Iterable[Finding]) -> list[Finding]:
    """The findings by grade; within a grade they stay in their order."""
    return sorted(findings, key=lambda finding: GRADES.index(finding.grade))


def refusal(error: MclError) -> Finding:
    """That a log cannot be read, as the reader says it."""
    do = f"{error.hint[:1].upper()}{error.hint[1:]}." if error.hint else "Record it again, or mend the file."
    place = "" if error.line is None else f"line {error.line}: "
    return Finding("broken", "reading", f"It cannot be read: {place}{error.message}.", do)


ADVICE: Final[Sequence[tuple[str, Grade, str, str]]] = (
    ("is cut", "doubtful", "file", "Copy the file again if the original is longer; else use it as far as it goes."),
    ("cut or damaged", "doubtful", "file", "Copy the file again if the original is whole; else use what is there."),
    ("read without its index", "doubtful", "file", "rosbag reindex mends the file; it is read all the same."),
    ("which is not here", "doubtful", "file", "Put the missing parts of the recording beside the others."),
    ("stamps ran backwards", "doubtful", "clocks",
     "Were lines swapped or sorted? Use the file as it was recorded; else the order of the lines counts."),
    ("begins anew", "doubtful", "clocks",
     "Is this two logs in one file? Then each part is a drive of its own, and the robot is carried off in between."),
    ("begins a new stretch", "doubtful", "clocks",
     "Was a simulation reset, or a recording played in a loop? Cut the file there unless you want a kidnapped robot."),
    ("their stamps are far from", "doubtful", "clocks",
     "A clock was set while it ran. Let the computers of the robot agree on the time before they record."),
    ("lines left out", "doubtful", "file", "Look at the lines named: were they edited, or cut by a full disk?"),
    ("was reset", "doubtful", "odometry",
     "The driver of the base was restarted, or its counter ran over. What follows is joined on; mend the driver."),
    ("gets there and back", "doubtful", "odometry", "The driver of the base sent wrong numbers; they are left out."),
    ("no robot says that", "doubtful", "numbers",
     "Somebody published numbers that were never filled in. They are left out; mend whoever sent them."),
    ("none of", "doubtful", "numbers", "Nothing of this can be used; mend whoever sent it."),
    ("quaternions are all zeros", "doubtful", "numbers",
     "Fill in w = 1 where nothing turns; heading is lost if the robot did turn."),
    ("is not used, and the laser alone", "doubtful", "odometry",
     "Mend the driver of the base: it publishes a pose that never changes."),
    ("never moves", "doubtful", "odometry",
     "Mend the driver of the base: it publishes a pose that never changes. What else tells the motion is used."),
    ("times and differently", "doubtful", "transforms",
     "Two nodes publish this transform. The last one counts; stop the one that is wrong."),
    ("no PARAM", "doubtful", "transforms", "Measure where the laser sits on the robot, and give --laser-pose X,Y,YAW."),
    (": in message", "doubtful", "laser", "Mend the driver of the laser."),
    ("range_min is taken for 0", "noted", "laser", "Let the driver say the shortest range of the laser."),
    ("was not taken", "noted", "topics", "--scan-topic takes it all the same."),
    ("--scan-topic takes another", "noted", "topics", "--scan-topic takes another one if this is the wrong laser."),
    ("--odom-topic takes another", "noted", "topics", "--odom-topic takes another one if this is the wrong odometry."),
    ("is taken, and not", "noted", "topics", NOTHING),
    ("onto the same angles", "noted", "laser", "Nothing, while they are few; else ask the driver for one setting."),
    ("before the first ODOM line", "noted", "odometry", NOTHING),
    ("beside the YAML is taken", "noted", "map", "Write the image's own name into the YAML."),
    ("taken for 0", "noted", "map", "Write a number into the origin of the map."),
    ("are kept that say anything", "noted", "map", "Nothing; cutting the image to the building saves time."),
    ("is transparent", "noted", "map", "Save the image without transparency."),
    ("would be unknown", "noted", "map",
     "Set free_thresh to 0.196 in the YAML, or the robot is looked for where nobody has been."),
    ("maps were recorded, and differ", "noted", "map", "Give the finished map with --map if the last one is not it."),
)  # fmt: skip
"""What to do about a remark of the reader: words that it holds, its grade, what it is about, and the advice."""


def of_remark(remark: str) -> Finding:
    """A finding from what the reader said of a recording."""
    text = f"{remark[:1].upper()}{remark[1:]}."
    for words, grade, about, do in ADVICE:
        if words in remark:
            return Finding(grade, about, text, do)
    return Finding("noted", "reading", text, NOTHING)
