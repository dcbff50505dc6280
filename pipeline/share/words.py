"""What is the matter at every scan of a run, in plain words, for somebody who was not there."""

from __future__ import annotations

import numpy as np

from pipeline.export.run import Run
from pipeline.filter.fates import clause
from pipeline.judgement.verdict import FEW, KINDS, SURE

MOST_PLACES = 3
"""Places that a sentence names where there are too many to be searched one by one."""
MANY = 0.25
"""Share of the beams that end too early, or go on too far, from which on it is worth a word."""
POOR = 0.5
"""Share of the beams that fit below which a place explains a scan badly."""
SCATTERED = 1.0
"""Spread, m, from which on a belief without hypotheses is not at one place."""


def matters(run: Run) -> list[str]:
    """A text for every scan: where the robot is believed to be, or might be, and why it is not known where not.

    Empty texts where an earlier version recorded no verdicts.
    """
    if not len(run.told.verdicts):
        return [""] * len(run.scenes)
    since = _beginnings(run)
    return [_matter(run, row, since[row]) for row in range(len(run.scenes))]


def _matter(run: Run, row: int, since: int) -> str:
    kind, probability = KINDS[run.told.verdicts[row]], float(run.told.probabilities[row])
    if kind == "found":
        told = [f"The robot is at {_place(run, row)}; {_sure(probability)}.", _beams(run, row)]
    elif kind == "off the map":
        told = [f"The robot is followed at {_place(run, row)}, where the map knows nothing; {_sure(probability)}."]
    elif kind == "ambiguous":
        told = [
            _places(run, row, FEW),
            "What the laser has seen does not decide between them.",
            _since(run, row, since),
            _beams(run, row),
        ]
    else:
        told = [*_why_lost(run, row, probability), _since(run, row, since), _beams(run, row)]
    return " ".join(sentence for sentence in (*told, _truth(run, row)) if sentence)


def _why_lost(run: Run, row: int, probability: float) -> tuple[str, str]:
    labels, spread = run.scenes.labels[row], float(run.scenes.curves["spread"][row])
    fits = float(run.scenes.curves["explained"][row])
    right = f"its pose is right with probability {_two(probability)}"
    if labels and _share(labels[0]) < SURE:
        return _places(run, row, MOST_PLACES), f"The first of them is right with probability {_two(probability)}."
    if spread > SCATTERED and not labels:
        return f"The belief is spread over {spread:.1f} m, and no place stands out:", f"{right}."
    if fits < POOR:
        return f"The only place that is left, {_at(run, row)}, fits badly:", f"{right}."
    return f"The belief is at {_at(run, row)}, but what the laser has seen is not enough to trust it:", f"{right}."


def _places(run: Run, row: int, most: int) -> str:
    """The best places with their shares, each with what became of the robot if it is there."""
    labels, centres = run.scenes.labels[row], run.scenes.hypotheses[row][:, :2].tolist()
    if not labels:
        return f"The robot may be at {_at(run, row)}, or elsewhere."
    told = [_named(label, x, y) for label, (x, y) in list(zip(labels, centres, strict=False))[:most]]
    others = f", and {len(labels) - len(told)} more" if len(labels) > len(told) else ""
    return f"The robot may be at any of {len(labels)} places: {'; '.join(told)}{others}."


def _named(label: str, x: float, y: float) -> str:
    share, _, name = label.partition(", ")
    return f"{share} at ({x:.1f}, {y:.1f}) m{f', if it {clause(name)}' if name else ''}"


def _beams(run: Run, row: int) -> str:
    """How the scan fits, and how the beams that do not fit miss."""
    scenes, fits = run.scenes, float(run.scenes.curves["explained"][row])
    if np.isnan(fits):
        return ""
    counts = [len(found[row]) for found in (scenes.hits, scenes.shorts, scenes.longs)]
    early, late = (count / max(sum(counts), 1) for count in counts[1:])
    told = [f"{100 * fits:.0f} % of the beams end where the map says"]
    if early > MANY:
        told.append(f"{100 * early:.0f} % end earlier, at something that the map lacks")
    if late > MANY:
        told.append(f"{100 * late:.0f} % go on where the map has a wall")
    return f"{_joined(told)}."


def _place(run: Run, row: int) -> str:
    sigma = np.sqrt(np.maximum(np.diagonal(run.told.covariances[row])[:2], 0.0)).max()
    about = f"{200 * sigma:.0f} cm" if 2 * sigma < 0.995 else f"{2 * sigma:.1f} m"
    yaw = float(np.degrees(run.told.poses[row, 2]))
    return f"{_at(run, row)}, give or take {about}, heading {yaw:.0f}°"


def _at(run: Run, row: int) -> str:
    x, y = run.told.poses[row, :2]
    return f"({x:.1f}, {y:.1f}) m"


def _sure(probability: float) -> str:
    return f"that is right with probability {_two(probability)}"


def _two(probability: float) -> str:
    return "above 0.99" if probability > 0.995 else f"{probability:.2f}"


def _since(run: Run, row: int, since: int) -> str:
    """When this verdict began, and what happened then; what happened a while before is in the list of events."""
    times, kind = run.scenes.times, KINDS[run.told.verdicts[row]]
    if kind in ("found", "off the map") or since == 0:
        return ""
    scans = run.scenes.scans[max(since - 1, 0)], run.scenes.scans[since]
    why = [e.text for e in run.told.events if e.level == "WARN" and scans[0] <= e.scan <= scans[1]]
    return f"So since {times[since]:.1f} s{': ' + why[0].partition('. ')[0].rstrip('.') if why else ''}."


def _truth(run: Run, row: int) -> str:
    x, y, _ = run.scenes.truth[row]
    if np.isnan(x):
        return ""
    apart = float(np.hypot(*(run.told.poses[row, :2] - (x, y))))
    return f"The truth is {apart:{'.2f' if apart < 1 else '.1f'}} m from there."


def _beginnings(run: Run) -> list[int]:
    """For every scan the one since which the robot is found, or is not."""
    known = np.isin(run.told.verdicts, [KINDS.index("found"), KINDS.index("off the map")])
    changes = np.concatenate([[True], known[1:] != known[:-1]])
    rows: list[int] = np.maximum.accumulate(np.where(changes, np.arange(len(known)), 0)).tolist()
    return rows


def _share(label: str) -> float:
    return float(label.partition(" %")[0]) / 100


def _joined(parts: list[str]) -> str:
    return ", ".join(parts[:-1]) + f" and {parts[-1]}" if len(parts) > 1 else parts[0]
