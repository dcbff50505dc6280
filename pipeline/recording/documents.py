"""The texts inside a recording, in Markdown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline.config import Config, dump_config
from pipeline.logs.messages import Log
from pipeline.recording.sensor_parts import WORDS, SensorParts

_EXPLANATION = """\
# What you see

A robot does not know where it is. Every dot is a guess of its pose, a *particle*, with a tick for the heading.
The robot moves, the particles move with it; the laser measures, and what does not fit dies out.

| drawn as | means |
|---|---|
| dots, yellow to dark violet | particles; the darker, the heavier: 1/100 to 100 times the mean weight |
| magenta ring and arrow | the estimate: the mean of the heaviest hypothesis |
| magenta ellipse | its position, 2 sigma |
| magenta line | where the estimate has been so far; not joined across jumps |
| blue lines | beams that end where the map says, laid out from the estimate |
| vermilion lines | beams that something stopped short: people, a shut door; or the estimate is wrong |
| black lines | beams that went on behind the map's wall: an open door; or the estimate is wrong |
| yellow dots | where the map ends the beams |
| grey stubs | beams without return |
| pink ellipses with a share | other hypotheses, with their part of the weight; after a gap, what became of the robot |
| a carpet of such dots | for a second, what a search of the building found: the best pose in each cell |
| vermilion, light blue and light green squares | where the world is not as mapped: a wall that the map lacks, one \
that is gone, floor of which the map knows nothing; shown once the scans that say so have proved right |
| light blue line | the path as known at the end of the log |
| green ring, arrow and line | the truth, where the log knows it |

The tab *The whole run*: above, what is the matter at this second, in words. Below that the whole map, and beside it
the same close up, where the estimate stays in the middle and north is up. Dots of vermilion at the ends of beams mark
those that the map explains least. Places in question have letters, A the heaviest, and their shares of the belief.
Where the believed robot is not where the true one is, both have their names. A bar says how long a metre is. Below:
whether the estimate can be trusted, and what happened until then; the tab *All events* has the rest.

The curves beside, from the top: the error against the truth, and 2 sigma, in metres (without
the truth, 2 sigma alone); the share of the beams that fit, and the probability that the estimate is right; the shares
of the beams that are stopped short and that pass through walls; how far the particles spread about the estimate. Once a
run is over its axes have room for nine tenths of the values: what is higher, like a search at the start, is cut off.

The tab *One scan* has the robot close up, and how the weights are distributed (grey: percent of the particles; magenta:
percent of the weight; 0 is the mean weight, 1 ten times that, the ends of the axis take what lies beyond); how many
particles there are and how many say as much (the effective number); the likelihood; and the sensor model in its parts
beside what this log measured.

The line below the map says what can be trusted. *Found*: the estimate is right with a probability of 90 % or more.
*Ambiguous*: a few places are in question, whose shares stand beside them. *Off the map*: the robot drives where the map
knows nothing, and its place follows from how it came there. *Lost*: anything else. Two curves tell why: beams that
end before what is mapped are stopped by something, people or new furniture; beams that end far behind a mapped wall,
several side by side, say that the wall is gone, or that the robot is elsewhere.

{sampling}
"""
_WITNESSES = """
## Wheels and laser

Two witnesses tell how the robot moved: the wheels, by how far they turned, and the laser, by how the walls that it
sees moved. Either may err: wheels slip, or count the wrong way; a laser sees nothing new along a bare corridor. A
particle follows one of them, and the weights decide whose particles go on. The tab *Wheels and laser* shows it.

| drawn as | means |
|---|---|
| brown line and arrow | the way as the wheels say |
| blue line and arrow | the way as the laser says, from the same start |
| thin magenta line and arrow | the way as it was believed: that of the estimate, once it knows where it is |
| black dots around the robot | walls that the laser remembers from the scans before |
| rays | the scan as the laser fits it to these walls: the fit is right where the rays end on the dots |
| brown and blue arrow at the robot, also on the map | wheels and laser contradict each other: from where the robot \
was a second ago to where either says that it is now; beside it, how much of the belief followed the laser |
| brown dots | where the scan would end if the wheels were right; if they are not, it misses the walls |

The line of states says whom most of the belief follows: the laser, the wheels, the wheels *roughly* after seconds that
are missing, or nobody, where the robot may have been carried. The curves below: how far wheels and laser are apart,
where 1 is the limit that two who are both right pass once in 100 scans; the share of the beams that fit the remembered
walls, where the laser says that the robot is (blue) and where the wheels say (brown); and how much of the belief
follows the laser (blue) and the wheels (brown).
"""
_LASER_ALONE = """
## The laser's odometry

The laser alone tells how the robot moved, by how the walls moved that it sees. The tab *The way by the laser* shows it.

| drawn as | means |
|---|---|
| blue line and arrow | the way as the laser says |
| thin magenta line and arrow | the way as it was believed: that of the estimate, once it knows where it is |
| black dots around the robot | walls that the laser remembers from the scans before |
| rays | the scan as the laser fits it to these walls: the fit is right where the rays end on the dots |

The curves below: the share of the beams that fit the remembered walls; and how much of the belief follows the laser
(blue) and how much what nobody saw, a move of any kind nearby (brown).
"""

_LOG = """\
A log before anybody has found the robot: the wheels tell how it moved, but not where in the building it began, so that
odometry and map are drawn apart. The wheels slip, and so the path bends and drifts.

| drawn as | means |
|---|---|
| brown ring, arrow and line | the robot by its wheels, and its path so far |
"""
_LOG_LASER = "| blue ring, arrow and line | the robot by its wheels and its laser together, from the same start |\n"
_LOG_STILL = """\
A log before anybody has found the robot. Nothing in it tells how the wheels turned, so that the robot is drawn standing
still, apart from the map, and what it sees moves around it.

| drawn as | means |
|---|---|
| brown ring and arrow | the robot, in its own frame |
"""
_LOG_BEAMS = "| blue dots | where the laser's beams end, as seen from the robot |\n"
_LOG_MAP = "| black, white and grey | the map's walls, what is free, and what nobody knows |\n"
_LOG_TRUTH = "| green ring, arrow and line | where it was in truth, with the same scan |\n"


def explanation(config: Config, *, wheels: bool = True, laser: bool = True) -> str:
    """What the colours and curves mean, as wheels and laser were heard; and how recorded particles were chosen."""
    sampling = (
        f"At most {config.record_particles} particles are recorded per scan: every k-th of the filter's list from a "
        "random start, so that each has the same chance to be drawn, whatever its weight. The histogram and the "
        "curves count all of them. What is drawn is rounded to 4 mm and 1 degree; the estimate is also stored exactly."
    )
    if config.filter == "grid":
        sampling += (
            "\n\nThis run kept the probability of every cell of the map in every heading (filter=grid): a dot is the "
            "centre of a cell. Where there are more cells than max_particles, so many are drawn by weight."
        )
    witnesses = "" if not laser else _WITNESSES if wheels else _LASER_ALONE
    return _EXPLANATION.format(sampling=sampling) + witnesses


def log_explanation(*, grid: bool, truth: bool, wheels: bool = True) -> str:
    """What the picture of a log shows, with a map, with the truth and with odometry where it knows them."""
    return (
        (_LOG + _LOG_LASER if wheels else _LOG_STILL)
        + _LOG_BEAMS
        + (_LOG_MAP if grid else "")
        + (_LOG_TRUTH if truth else "")
    )


def run(log: Log, config: Config, seed: int, versions: Mapping[str, str]) -> str:
    """What was localised, with which parameters and versions."""
    grid = log.grid
    assert grid is not None
    facts = {
        "log": f"{log.name} ({len(log)} scans, {log.duration:.1f} s)",
        "log SHA-256": f"`{log.sha256}`",
        "map": f"{grid.width} x {grid.height} cells of {grid.resolution:g} m",
        "map SHA-256": f"`{grid.sha256}`",
        "seed": str(seed),
        **versions,
    }
    return f"# Run\n\n{_table('', facts)}\n\n## Configuration\n\n```yaml\n{dump_config(config)}```\n"


def result(figures: Mapping[str, Any]) -> str:
    """What came out, as a table."""
    return f"# Result\n\n{_table('figure', {k: _shown(v) for k, v in figures.items()})}\n"


def sensor_model(parts: SensorParts, config: Config) -> str:
    """What the chart of the sensor model shows, and how far the log is from it."""
    weighed = ""
    if config.sensor_model != "beam":
        weighed = (
            f" **The particles of this run were weighed by {config.sensor_model} instead**: the beam model "
            "only proposed where they start, and where the robot might be when it seemed lost."
        )
    shares = parts.shares()
    measured = ["-"] * len(WORDS) if shares.measured is None else [f"{share:.1f} %" for share in shares.measured]
    measured[WORDS.index("random")] = "among short and too long"
    rows = [
        f"| {word} | {model:.1f} % | {seen} |" for word, model, seen in zip(WORDS, shares.model, measured, strict=True)
    ]
    return (
        f"Per cent of the readings *z* in {parts.width:g} m, where the map's range is *z\\** = {parts.wall:g} m. In "
        "each bin on the left the model, its parts on top of each other: hit (blue), short (vermilion), too long "
        "(black), random (orange), and at the far right without return (grey). On the right in magenta what "
        f"{parts.seen:,} beams of this log measured there. The beams that the map "
        f"explains least are marked with dots on the map.{weighed}\n\n| part | model | this log |\n|---|---|---|\n"
        + "\n".join(rows)
    )


def _table(title: str, rows: Mapping[str, str]) -> str:
    lines = [f"| {title} | |", "|---|---|", *(f"| {key} | {value} |" for key, value in rows.items())]
    return "\n".join(lines)


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list | tuple):
        return ", ".join(_shown(v) for v in value)
    return str(value)
