"""One page with a run and a small player of our own: a canvas, a time line, curves, and what happened."""

from __future__ import annotations

import base64
import gzip
import html
import json
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.export.run import Run
from pipeline.recording import palette
from pipeline.recording.gaps import longest_interval
from pipeline.recording.scenes import Ragged

STEPS = 65_535
MOST_PARTICLES = 3_000_000
"""In a page: of longer runs every k-th is left."""
PER_SCAN = 700
"""Particles that a scan keeps."""
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


def page(run: Run) -> str:
    """The whole page, HTML; it refers to nothing outside of itself."""
    head, data = packed(run)
    template = resources.files("pipeline.share").joinpath("player.html").read_text(encoding="utf-8")
    # A name may hold anything; what might end a script is spelt otherwise.
    text = json.dumps(head, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    before, _, rest = template.replace("@TITLE@", html.escape(f"{run.name}, seed {run.seed}")).partition("@HEAD@")
    between, _, after = rest.partition("@DATA@")
    return f"{before}{text}{between}{base64.b64encode(data).decode('ascii')}{after}"


def packed(run: Run) -> tuple[dict[str, Any], bytes]:
    """What the player needs: names, texts and where the arrays lie; and these, one after the other, gzipped."""
    scenes, told = run.scenes, run.told
    rays = {name: getattr(scenes, name) for name in ("hits", "shorts", "longs", "no_return", "expected")}
    kept = _thinned(scenes.particles)
    particles, levels = Ragged(scenes.particles.values[kept.values], kept.offsets), scenes.levels.values[kept.values]
    places = {**rays, "particles": particles, "heat": scenes.heat}
    everything = np.concatenate([run.area, *(p.values[:, :2] for p in places.values())])
    low, high = everything.min(axis=0), everything.max(axis=0)
    step = float(max(*(high - low), 1e-3)) / STEPS
    sigmas = np.sqrt(np.maximum(np.diagonal(told.covariances, axis1=1, axis2=2), 0.0))
    arrays: dict[str, NDArray[Any]] = {
        "times": scenes.times,
        "scans": scenes.scans.astype(np.uint32),
        "estimates": _single(scenes.estimates),
        "lasers": _single(scenes.lasers),
        "sigmas": _single(sigmas),
        "truth": _single(scenes.truth),
        "hindsight": _single(scenes.hindsight.values),
        "hindsight_at": scenes.hindsight.offsets.astype(np.uint32),
        "joined": scenes.joined.astype(np.uint8),
        "shades": scenes.shades,
        "heading": np.round(particles.values[:, 2] * (128 / np.pi)).astype(np.int64).astype(np.uint8),
        "level": levels.astype(np.uint8),
        "heat_level": scenes.heat.values[:, 2].astype(np.uint8),
        "count": _single(scenes.curves["particles"]),
    }
    for name, ragged in places.items():
        arrays[name] = np.round((ragged.values[:, :2] - low) / step).astype(np.uint16)
        arrays[f"{name}_at"] = ragged.offsets.astype(np.uint32)
    for name, ragged in (("ellipses", scenes.ellipses), ("hypotheses", scenes.hypotheses)):
        arrays[name], arrays[f"{name}_at"] = _single(ragged.values), ragged.offsets.astype(np.uint32)
    curves = [
        {"name": name, "words": words, "colour": colour, "limit": limit}
        for name, words, colour, limit in (
            ("explained", "share of the beams explained", palette.CURVE, 1.0),
            ("spread", "spread of the particles, m", palette.ESTIMATE, None),
            ("ess", "effective sample size", palette.HIT, None),
        )
    ]
    arrays |= {str(c["name"]): _single(scenes.curves[str(c["name"])]) for c in curves}
    where, data = _laid_out(arrays)
    x, y, yaw = scenes.grid.origin
    head = {
        "log": run.name,
        "seed": run.seed,
        "damage": told.damage,
        # How often it resamples is no event to somebody who watches; a curve shows it.
        "events": [{"time": e.time, "level": e.level, "text": e.text} for e in told.events if e.kind != "resampled"],
        "labels": [list(row) for row in scenes.labels],
        "map": {
            "width": scenes.grid.width,
            "height": scenes.grid.height,
            "resolution": scenes.grid.resolution,
            "origin": [x, y, yaw],
        },
        "low": low.tolist(),
        "step": step,
        "area": [*run.area[0].tolist(), *run.area[1].tolist()],
        "unknown": palette.UNKNOWN,
        "weights": palette.WEIGHT_COLOURS.tolist(),
        "colours": _COLOURS,
        "layers": _layers(run),
        "curves": curves,
        "gap": longest_interval(scenes.times) if len(scenes) > 1 else 0.0,
        "about": _about(run),
        "arrays": where,
    }
    return head, gzip.compress(data, 9, mtime=0)


def _thinned(particles: Ragged) -> Ragged:
    """Indices of the particles that stay, evenly over each scan's, which are sorted by weight."""
    most = int(np.clip(MOST_PARTICLES / max(len(particles), 1), 1, PER_SCAN))
    kept = np.minimum(particles.lengths, most)
    offsets = np.concatenate([[0], np.cumsum(kept)])
    within = np.arange(offsets[-1]) - np.repeat(offsets[:-1], kept)
    stride = np.repeat(particles.lengths / np.maximum(kept, 1), kept)
    return Ragged(np.repeat(particles.offsets[:-1], kept) + ((within + 0.5) * stride).astype(np.int64), offsets)


def _laid_out(arrays: dict[str, NDArray[Any]]) -> tuple[list[tuple[str, str, int, int]], bytes]:
    """Name, kind, first byte and length of every array; and all of them, each where an 8-byte number may begin."""
    where, parts, at = [], [], 0
    for name, values in arrays.items():
        flat = np.ascontiguousarray(values).reshape(-1)
        data = flat.astype(flat.dtype.newbyteorder("<"), copy=False).tobytes()
        data += bytes(-len(data) % 8)
        where.append((name, f"{flat.dtype.kind}{flat.dtype.itemsize}", at, len(flat)))
        parts.append(data)
        at += len(data)
    return where, b"".join(parts)


def _layers(run: Run) -> list[tuple[str, str, Any]]:
    scenes = run.scenes
    wanted = [
        ("particles", "particles; the darker, the heavier", None, True),
        ("estimate", "estimate, its path, 2 sigma", palette.ESTIMATE, True),
        ("hypotheses", "other hypotheses, share of weight", palette.HYPOTHESIS, len(scenes.hypotheses.values)),
        ("hits", "beams that fit the map", palette.HIT, True),
        ("shorts", "that something stopped short", palette.SHORT, True),
        ("longs", "that went on behind a wall", palette.LONG, True),
        ("expected", "where the map ends them", palette.EXPECTED, True),
        ("no_return", "no return (stubs)", palette.NO_RETURN, len(scenes.no_return.values)),
        ("heat", "best places of a search", None, len(scenes.heat.values)),
        ("hindsight", "known in hindsight", palette.HINDSIGHT, len(scenes.hindsight)),
        ("truth", "truth", palette.TRUTH, not np.isnan(scenes.truth).all()),
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


def _single(values: NDArray[Any]) -> NDArray[np.float32]:
    return np.ascontiguousarray(values, dtype=np.float32)
