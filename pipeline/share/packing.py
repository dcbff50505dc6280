"""The arrays of a run as a page holds them: as few bytes as a screen can show, one after the other, gzipped."""

from __future__ import annotations

import gzip
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.compare import errors
from pipeline.export.run import Run
from pipeline.recording.scenes import Ragged, Scenes

STEPS = 65_535
MOST_PARTICLES = 3_000_000
"""In a page: of longer runs every k-th is left."""
PER_SCAN = 700
"""Particles that a scan keeps."""
Arrays = dict[str, NDArray[Any]]
_DRAWN = ("hits", "shorts", "longs", "no_return", "expected", "heat")


def extent(runs: Sequence[Run]) -> tuple[NDArray[np.float64], float]:
    """The lowest (x, y) that is drawn of any run, m, and the length of one of ``STEPS`` steps, m."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for run in runs:
        scenes = run.scenes
        drawn = (getattr(scenes, name).values[:, :2] for name in _DRAWN)
        for places in (*run.area, scenes.particles.values[:, :2], scenes.changed.values[:, :2], *drawn):
            if places.size:
                low, high = np.minimum(low, places.min(axis=0)), np.maximum(high, places.max(axis=0))
    return low, float(max(*(high - low), 1e-3)) / STEPS


def run_arrays(run: Run, low: NDArray[np.float64], step: float, *, share: float = 1.0) -> Arrays:
    """What is drawn of a run, by name; positions in steps from ``low``; ``share`` of the usual number of particles."""
    scenes, told = run.scenes, run.told
    kept = _thinned(scenes.particles, share)
    particles = Ragged(scenes.particles.values[kept.values], kept.offsets)
    places = {name: getattr(scenes, name) for name in _DRAWN} | {"particles": particles}
    sigmas = np.sqrt(np.maximum(np.diagonal(told.covariances, axis1=1, axis2=2), 0.0))
    arrays: Arrays = {
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
        "level": scenes.levels.values[kept.values].astype(np.uint8),
        "heat_level": scenes.heat.values[:, 2].astype(np.uint8),
        "count": _single(scenes.curves["particles"]),
        "verdicts": told.verdicts.astype(np.uint8),
        "error": _single(errors(run)[0]),
        "probability": _single(told.probabilities),
        **{name: _single(scenes.curves[name]) for name in ("explained", "spread", "ess")},
        **_changed(scenes, low, step),
        **_texts([plain(text) for text in scenes.captions], scenes.labels),
    }
    for name, ragged in places.items():
        arrays[name] = _steps(ragged.values, low, step)
        arrays[f"{name}_at"] = ragged.offsets.astype(np.uint32)
    for name, ragged in (("ellipses", scenes.ellipses), ("hypotheses", scenes.hypotheses)):
        arrays[name], arrays[f"{name}_at"] = _single(ragged.values), ragged.offsets.astype(np.uint32)
    return arrays


def track_arrays(times: NDArray[np.float64], poses: NDArray[np.float64]) -> Arrays:
    """What is drawn of another filter's way: poses (n, 3) at times (n,) s."""
    return {"times": times, "estimates": _single(poses), "joined": np.ones(len(times), np.uint8)}


def laid_out(parts: Sequence[Mapping[str, NDArray[Any]]]) -> tuple[list[list[tuple[str, str, int, int]]], bytes]:
    """Name, kind, first byte and length of every array of every part; and all of them, each where an 8-byte number may
    begin, gzipped."""
    where: list[list[tuple[str, str, int, int]]] = []
    data, at = [], 0
    for arrays in parts:
        where.append([])
        for name, values in arrays.items():
            flat = np.ascontiguousarray(values).reshape(-1)
            raw = flat.astype(flat.dtype.newbyteorder("<"), copy=False).tobytes()
            raw += bytes(-len(raw) % 8)
            where[-1].append((name, f"{flat.dtype.kind}{flat.dtype.itemsize}", at, len(flat)))
            data.append(raw)
            at += len(raw)
    return where, gzip.compress(b"".join(data), 9, mtime=0)


def plain(caption: str) -> str:
    """A caption of the recording, which is Markdown, as a text: its headline as the first sentence."""
    headline, _, rest = caption.partition("\n")
    return f"{headline.removeprefix('# ')}. {rest.replace('**', '')}" if headline else ""


def _thinned(particles: Ragged, share: float) -> Ragged:
    """Indices of the particles that stay, evenly over each scan's, which are sorted by weight."""
    most = int(np.clip(share * MOST_PARTICLES / max(len(particles), 1), 1, max(share * PER_SCAN, 1)))
    kept = np.minimum(particles.lengths, most)
    offsets = np.concatenate([[0], np.cumsum(kept)])
    within = np.arange(offsets[-1]) - np.repeat(offsets[:-1], kept)
    stride = np.repeat(particles.lengths / np.maximum(kept, 1), kept)
    return Ragged(np.repeat(particles.offsets[:-1], kept) + ((within + 0.5) * stride).astype(np.int64), offsets)


def _changed(scenes: Scenes, low: NDArray[np.float64], step: float) -> Arrays:
    """Every cell that is not as mapped once for each span of rows in which it is known to be so."""
    updates = np.repeat(np.arange(len(scenes.changed)), scenes.changed.lengths)
    cells, inverse = np.unique(scenes.changed.values, axis=0, return_inverse=True)
    order = np.lexsort((updates, inverse.reshape(-1)))
    cell, update = inverse.reshape(-1)[order], updates[order]
    begins = np.flatnonzero(np.diff(cell, prepend=-1).astype(bool) | (np.diff(update, prepend=-2) != 1))
    ends = np.append(begins[1:], len(cell))[: len(begins)] - 1
    rows = np.append(scenes.changed_at, len(scenes))
    shown = cells[cell[begins]]
    return {
        "changed": _steps(shown, low, step),
        "changed_kind": shown[:, 2].astype(np.uint8),
        "changed_from": rows[update[begins]].astype(np.uint32),
        "changed_until": rows[update[ends] + 1].astype(np.uint32),
    }


def _texts(said: Sequence[str], labels: Sequence[Sequence[str]]) -> Arrays:
    """What is said at every scan: all texts once, and which of them."""
    once = {text: k for k, text in enumerate(dict.fromkeys(said))}
    text = json.dumps({"said": list(once), "labels": [list(row) for row in labels]}, separators=(",", ":"))
    return {
        "texts": np.frombuffer(text.encode(), np.uint8),
        "said_at": np.array([once[one] for one in said], np.uint32),
    }


def _steps(places: NDArray[np.float64], low: NDArray[np.float64], step: float) -> NDArray[np.uint16]:
    return np.round((places[:, :2] - low) / step).astype(np.uint16)


def _single(values: NDArray[Any]) -> NDArray[np.float32]:
    return np.ascontiguousarray(values, dtype=np.float32)
