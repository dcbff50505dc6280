"""One page with a run, or several on one clock, and a small player: maps, a time line, and what is the matter."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from string import ascii_uppercase
from typing import Any

import numpy as np

from pipeline.compare import Compared, Stretch, Track, compare, table, track_errors
from pipeline.export.run import Run
from pipeline.judgement.verdict import KINDS
from pipeline.recording import palette
from pipeline.recording.gaps import longest_interval
from pipeline.recording.side_by_side import same_map
from pipeline.share.packing import Arrays, extent, laid_out, run_arrays, track_arrays
from pipeline.share.template import as_json, filled

_COLOURS = {
    "estimate": palette.ESTIMATE,
    "truth": palette.TRUTH,
    "hits": palette.HIT,
    "shorts": palette.SHORT,
    "longs": palette.LONG,
    "no_return": palette.NO_RETURN,
    "expected": palette.EXPECTED,
    "hypotheses": palette.HYPOTHESIS,
    "hindsight": palette.HINDSIGHT,
}
_SCRIPTS = ("data.js", "map.js", "charts.js", "player.js")


def page(compared: Sequence[Compared]) -> str:
    """The whole page, HTML, of a run alone, or of one beside other runs and tracks; it refers to nothing outside.

    Of several the first is a run, and what is called A.
    """
    head, data = packed(compared)
    parts = {"HEAD": as_json(head), "DATA": base64.b64encode(data).decode("ascii")}
    title = " and ".join(dict.fromkeys(_name(one) for one in compared))
    return filled("player.html", title=title, styles=["player.css"], scripts=_SCRIPTS, parts=parts)


def packed(compared: Sequence[Compared]) -> tuple[dict[str, Any], bytes]:
    """What the player needs: names, texts and where the arrays lie; and these, gzipped."""
    runs = [one for one in compared if isinstance(one, Run)]
    first, alone = runs[0], len(compared) == 1
    low, step = extent(runs)
    arrays: list[Arrays] = []
    for one in compared:
        shift = _shift(one, first)
        if isinstance(one, Run):
            arrays.append(run_arrays(one, low, step, share=1 / len(runs)))
            arrays[-1]["times"] = one.scenes.times + shift
        else:
            times = (one.trajectory.stamps - one.trajectory.stamps[0]) / 1e9 + shift
            arrays.append(track_arrays(times, one.trajectory.poses))
    events = [event for k, run in enumerate(compared) if isinstance(run, Run) for event in _events(run, k, first)]
    for k, one in enumerate(compared[1:], start=1):
        found = compare(first, one)
        arrays[k] |= {"apart_times": found.times, "apart": found.distances.astype(np.float32)}
        if isinstance(one, Track):
            error = track_errors(one, first)[0]
            arrays[k] |= {"error_times": found.times, "error": error.astype(np.float32)}
        events += [_parting(stretch, k) for stretch in found.apart]
    where, data = laid_out(arrays)
    rows = {} if alone else table(compared)
    head = {
        "title": _name(first) if alone else ", ".join(dict.fromkeys(run.name for run in runs)),
        "runs": [
            {
                "name": _name(one),
                "arrays": found,
                **_looks(one, k, alone),
                **(_run(one) if isinstance(one, Run) else {}),
            }
            for k, (one, found) in enumerate(zip(compared, where, strict=True))
        ],
        "one_map": all(same_map(run.scenes, first.scenes) for run in runs),
        "events": sorted(events, key=lambda event: float(event["time"])),
        "low": low.tolist(),
        "step": step,
        "unknown": palette.UNKNOWN,
        "weights": palette.WEIGHT_COLOURS.tolist(),
        "changed": palette.CHANGED_COLOURS.tolist(),
        "colours": _COLOURS,
        "verdicts": [[kind, palette.VERDICTS[kind]] for kind in KINDS],
        "layers": _layers(runs, alone),
        "curves": _curves(runs, alone),
        "table": [[name, *texts] for name, texts in rows.items()],
        "about": _about(first) if alone else "",
    }
    return head, data


def _name(one: Compared) -> str:
    return one.name if isinstance(one, Track) else f"{one.name}, seed {one.seed}"


def _shift(one: Compared, first: Run) -> float:
    """Seconds to add to its times, which begin with it, so that the clock is that of the first run.

    0 for a run of another time: it begins with the clock.
    """
    stamps = one.trajectory.stamps if isinstance(one, Track) else one.told.stamps
    clock = first.told.stamps
    if isinstance(one, Run) and (stamps[0] > clock[-1] or stamps[-1] < clock[0]):
        return 0.0
    begins = 0.0 if isinstance(one, Track) else float(one.told.times[0])
    return float(stamps[0] - clock[0]) / 1e9 + float(first.told.times[0]) - begins


def _events(run: Run, k: int, first: Run) -> list[dict[str, Any]]:
    # How often it resamples is no event to somebody who watches; a curve shows it.
    shift = _shift(run, first)
    return [
        {"time": event.time + shift, "level": event.level, "run": k, "text": event.text}
        for event in run.told.events
        if event.kind != "resampled"
    ]


def _parting(stretch: Stretch, k: int) -> dict[str, Any]:
    turn = np.degrees(stretch.turn)
    text = (
        f"Parts from A at {stretch.begin:.1f} s: {stretch.distance:.2f} m and {turn:.0f} deg apart; "
        f"until {stretch.end:.1f} s, at the worst {stretch.most:.2f} m."
    )
    return {"time": stretch.begin, "level": "WARN", "run": k, "text": text}


def _looks(one: Compared, k: int, alone: bool) -> dict[str, Any]:
    return {
        "letter": "" if alone else ascii_uppercase[k],
        "colour": palette.ESTIMATE if alone else palette.RUNS[k % len(palette.RUNS)],
        "track": isinstance(one, Track),
    }


def _run(run: Run) -> dict[str, Any]:
    scenes, told = run.scenes, run.told
    x, y, yaw = scenes.grid.origin
    return {
        "about": f"{told.scans:,} scans in {told.duration:.1f} s",
        "damage": told.damage,
        "gap": longest_interval(scenes.times) if len(scenes) > 1 else 0.0,
        "area": [*run.area[0].tolist(), *run.area[1].tolist()],
        "map": {
            "width": scenes.grid.width,
            "height": scenes.grid.height,
            "resolution": scenes.grid.resolution,
            "origin": [x, y, yaw],
        },
    }


def _curves(runs: Sequence[Run], alone: bool) -> list[dict[str, Any]]:
    """What is plotted; the first of them right above the time line."""
    colour = {"error": palette.ESTIMATE, "probability": palette.TRUTH, "explained": palette.CURVE}
    wanted = (
        ("error", "error of the estimate, m", "logarithmic", any(not np.isnan(run.scenes.truth).all() for run in runs)),
        ("apart", "distance from A, m", "logarithmic", not alone),
        ("probability", "probability that the pose is right", "share", any(len(run.told.verdicts) for run in runs)),
        ("explained", "share of the beams explained", "share", True),
        ("spread", "spread of the particles, m", "linear", True),
        ("ess", "effective sample size", "linear", True),
    )
    return [
        {"name": name, "words": words, "axis": axis, "colour": colour.get(name, palette.HIT)}
        for name, words, axis, there in wanted
        if there
    ]


def _layers(runs: Sequence[Run], alone: bool) -> list[tuple[str, str, Any]]:
    def any_has(name: str) -> bool:
        return any(len(getattr(run.scenes, name).values) for run in runs)

    wanted = [
        ("particles", "particles; the darker, the heavier", None, True),
        ("estimate", "estimate, its path, 2 sigma", palette.ESTIMATE if alone else "runs", True),
        ("hypotheses", "other hypotheses, share of weight", palette.HYPOTHESIS, any_has("hypotheses")),
        ("hits", "beams that fit the map", palette.HIT, True),
        ("shorts", "that something stopped short", palette.SHORT, True),
        ("longs", "that went on behind a wall", palette.LONG, True),
        ("expected", "where the map ends them", palette.EXPECTED, True),
        ("no_return", "no return (stubs)", palette.NO_RETURN, any_has("no_return")),
        ("new", "wall that the map lacks", palette.CHANGED_COLOURS[1].tolist(), any_has("changed")),
        ("gone", "wall of the map that is gone", palette.CHANGED_COLOURS[2].tolist(), any_has("changed")),
        ("floor", "floor where the map ends", palette.CHANGED_COLOURS[3].tolist(), any_has("changed")),
        ("heat", "best places of a search", None, any_has("heat")),
        ("hindsight", "known in hindsight", palette.HINDSIGHT, any_has("hindsight")),
        ("truth", "truth", palette.TRUTH, any(not np.isnan(run.scenes.truth).all() for run in runs)),
    ]
    return [(name, words, colour) for name, words, colour, there in wanted if there]


def _about(run: Run) -> str:
    told = run.told
    lines: list[str] = []
    for title, values in (("Result", told.figures), ("Parameters", told.config), ("Versions", told.versions)):
        lines += [title, *(f"  {key}: {_shown(value)}" for key, value in values.items()), ""]
    return "\n".join(lines)


def _shown(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
