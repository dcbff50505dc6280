"""The whole look: recording, log, wheels, map and parameters, put together."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from converters.bag import DESCRIPTION as BAG
from converters.bag_file import open_recording
from converters.cached import Converted, converted, read
from pipeline.check.container import findings_of_container, findings_of_text
from pipeline.check.findings import Finding, of_remark, refusal, worst_first
from pipeline.check.laser import findings_of_laser, findings_of_limits, findings_of_message
from pipeline.check.map import findings_of_map, findings_of_truth, place
from pipeline.check.odometry import findings_of_transforms, hear
from pipeline.check.recording import SeenTopic, findings_of_clocks, findings_of_times, topics_of
from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.logs import schema
from pipeline.logs.decode import typestore
from pipeline.logs.messages import Log
from pipeline.logs.recorded import Names, Recorded
from pipeline.maps.occupancy_grid import OccupancyGrid

FEWEST = 3
"""Scans without which there is nothing to compare."""


@dataclass(frozen=True)
class Report:
    """What a look at a log found: ``facts`` as (name, value) texts, its ``topics``, the ``findings``, worst first.

    ``duration``: seconds from the first scan to the last, 0 where the log cannot be read; ``scans_begin``: when the
    first scan was written down, in the time of the topics, s.
    """

    path: Path
    facts: tuple[tuple[str, str], ...]
    topics: tuple[SeenTopic, ...]
    findings: tuple[Finding, ...]
    duration: float = 0.0
    scans_begin: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        """As plain values, ready for JSON."""
        return {
            "log": str(self.path),
            "facts": dict(self.facts),
            "topics": [topic.to_dict() for topic in self.topics],
            "findings": [finding.to_dict() for finding in self.findings],
        }


def look(
    path: Path,
    config: Config,
    *,
    names: Names | None = None,
    grid: OccupancyGrid | None = None,
    seed: int = 0,
    step: Callable[[str], object] = str,
) -> Report:
    """Everything about one log, whatever its format; ``grid`` instead of its own map. ``step`` is told what comes next.

    A log that cannot be read is a finding like others. Raises MclError if there is no file, or one of no known format.
    """
    step("reading")
    into = _converted_or_refused(path, names)
    if isinstance(into, MclError):
        topics, seen = _recording(path)
        return Report(path, (), tuple(topics), tuple(worst_first([refusal(into), *seen])))
    bag = into is not None and into.format == BAG
    text = into is not None and not bag
    source = path if into is None or bag else into.mcap
    topics, seen = _recording(source)
    try:
        opened = read(path, grid, names)
    except MclError as error:
        return Report(path, (), tuple(topics), tuple(worst_first([refusal(error), *seen])))
    log = opened.log
    remarks = list(dict.fromkeys([*opened.log.remarks, *(() if grid is None else grid.remarks)]))
    found = [of_remark(remark) for remark in remarks]
    found += findings_of_text(path) if text else [finding for finding in seen if finding not in found]
    chosen = log.metadata.get(schema.SOURCE if bag else schema.READER, {})
    scan_topic, odometry_topic = (chosen.get(key, "") for key in ("scan_topic", "odometry_topic"))
    found += [*findings_of_clocks(log, topics, scan_topic, odometry_topic), *_angles(source, scan_topic)]
    found += at_a_glance(log, config)
    heard = None
    if len(log) >= FEWEST:
        step("hearing wheels and laser")
        heard = hear(log, config)
        found += heard.findings
    explained = None
    if log.grid is not None and not any(finding.grade == "broken" for finding in found if finding.about == "map"):
        step("looking for the robot in the map")
        try:
            tried = place(log, config, seed)
            found += tried.findings
            explained = tried.explained
        except MclError as error:
            found.append(refusal(error))
    facts = [("format", opened.format or "MCAP"), *_facts(log, scan_topic, odometry_topic)]
    if heard is not None:
        wheels = "" if heard.wheels is None else f"{heard.wheels:.1f} m by the wheels, "
        facts.append(("driven", f"{wheels}{heard.laser:.1f} m by the laser"))
    if explained is not None:
        facts.append(("explained by the map", f"{100 * explained:.0f} % of the beams, at the best place"))
    begin = next((float(t.times[0]) for t in topics if t.name == scan_topic and t.times is not None), 0.0)
    return Report(path, tuple(facts), tuple(topics), tuple(worst_first(found)), log.duration, begin)


def at_a_glance(log: Log, config: Config) -> list[Finding]:
    """What takes no time to see: nothing is localized, and laser and wheels are not compared."""
    return [
        *findings_of_times(log),
        *findings_of_laser(log),
        *findings_of_limits(log, config),
        *findings_of_transforms(log),
        *findings_of_map(log, config),
        *findings_of_truth(log),
    ]


def _converted_or_refused(path: Path, names: Names | None) -> Converted | MclError | None:
    """What a raw log or a bag became, None for an .mcap; the error where its content is to blame.

    Raises MclError if there is no such file, or it is of no known format.
    """
    from converters import format_of

    try:
        return converted(path, names)
    except MclError as error:
        format_of(path)  # which says what no look can go beyond
        return error


def _recording(path: Path) -> tuple[list[SeenTopic], list[Finding]]:
    """Topics and oddities of a recording, as far as it can be opened."""
    try:
        with open_recording(path) as recorded:
            return topics_of(recorded), [*map(of_remark, recorded.remarks), *findings_of_container(path, recorded)]
    except MclError:  # a raw log that became nothing, or a recording without a sound topic
        return [], []


def _angles(path: Path, scan_topic: str) -> list[Finding]:
    with open_recording(path) as opened:
        recorded: Recorded = opened
        topic = recorded.topics.get(scan_topic or schema.SCAN)
        if topic is None or topic.type != schema.LASER_SCAN_TYPE or not topic.count:
            return []
        said = recorded.messages([topic.name])[topic.name]
    try:
        return list(findings_of_message(typestore().deserialize_cdr(said.data[0], topic.type)))
    except Exception:  # a first message that is none: the reader says what it did about it
        return []


def _facts(log: Log, scan_topic: str, odometry_topic: str) -> list[tuple[str, str]]:
    laser, grid = log.laser, log.grid
    rate = f", {(len(log) - 1) / log.duration:.1f} a second" if log.duration > 0.0 else ""
    x, y, yaw = laser.pose
    rows = [
        ("scans", f"{len(log):,} in {log.duration:.1f} s{rate}"),
        ("laser", f"{laser.beams} beams over {math.degrees(laser.angle_increment * (laser.beams - 1)):.0f} deg, "
         f"{laser.range_min:g} to {laser.range_max:g} m"),
        ("laser on the robot", f"x {x:.2f} m, y {y:.2f} m, yaw {math.degrees(yaw):.0f} deg"),
        ("odometry", (odometry_topic or "in the log") if log.wheels else "none"),
    ]  # fmt: skip
    if scan_topic:
        rows.insert(0, ("read from", scan_topic))
    if grid is not None:
        rows.append(("map", f"{grid.width:,} x {grid.height:,} cells of {grid.resolution:g} m"))
    if log.stretches is not None:
        rows.append(("stretches", str(int(log.stretches.max()) + 1)))
    return rows
