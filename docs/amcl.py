"""What a nav2 parameter file does in AMCL itself: nav2_amcl's filter, written anew in plain loops, run over logs.

    python docs/amcl.py --log LOG.mcap TRUTH.tum --file default --file nav2_params.yaml --runs 5

is how the table of docs/tuning.md was made; `--laser-truth` says that TRUTH.tum has the poses of the laser. AMCL is
given the first pose as somebody would click it in RViz (off by 0.2 m and 5 degrees at one deviation, with RViz's
covariance), hears the wheels alone, and says at every scan where the robot is: its last estimate, and what the wheels
count since. It shares the reader and the map with the product, and nothing of its filter: motion model, both likelihood
fields, resampling with KLD, random poses and clusters are as in nav2_amcl. AMCL's beam model is left out.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from ruamel.yaml import YAML

from pipeline import read_log
from pipeline.evaluate.metrics import interpolate, is_localized, laser_to_base, pose_errors
from pipeline.geometry import compose, inverse, wrap_angle
from pipeline.logs.messages import Log
from pipeline.logs.tum import read_tum
from pipeline.maps.distance_field import build_distance_field
from pipeline.nav2 import DEFAULTS, given_in

Array = NDArray[np.float64]
CLICKED = (0.2, 0.2, math.radians(5.0))
"""m, m, rad: deviations of the pose that somebody gives."""
RVIZ = (0.5, 0.5, math.radians(15.0))
"""m, m, rad: deviations that RViz states with it."""
OCCUPIED = 0.65
"""From which probability on map_server draws a wall."""
BIN = (0.5, 0.5, math.radians(10.0))
"""m, m, rad: cells of the histogram that KLD counts and clusters are made of."""
CONVERGED = 0.5
"""m: AMCL skips beams once all particles are so near their mean."""


def run(log: Log, given: Mapping[str, Any], start: Array, seed: int) -> Array:
    """Poses (n, 3) in the map frame at every scan of the log, for AMCL's parameters ``given`` by name."""
    assert log.grid is not None
    grid, laser = log.grid, log.laser
    field = build_distance_field(grid, OCCUPIED, given["laser_likelihood_max_dist"])
    distances = field.distances[field.codes]
    longest, shortest = given["laser_max_range"], given["laser_min_range"]
    range_max = min(longest, laser.range_max) if longest > 0.0 else laser.range_max
    range_min = max(shortest, laser.range_min) if shortest > 0.0 else laser.range_min
    prob = given["laser_model_type"] == "likelihood_field_prob"
    if prob:
        step = math.ceil(laser.beams / given["max_beams"])
    else:
        step = max(1, (laser.beams - 1) // (given["max_beams"] - 1))
    angles = laser.angles[::step] + laser.pose[2]
    free = np.argwhere(~grid.occupied(0.25))
    rng = np.random.default_rng(seed)
    most = max(given["max_particles"], given["min_particles"])
    clicked = start + rng.normal(0.0, CLICKED)
    particles = grid.to_grid(clicked) + rng.normal(0.0, RVIZ, (most, 3))
    weights = np.full(most, 1.0 / most)
    alphas = np.array([given[f"alpha{k}"] for k in range(1, 5)])
    slow = fast = 0.0
    updated: Array | None = None
    count = 0
    out = np.empty((len(log), 3))
    offset = compose(clicked, inverse(log.odometry[0]))
    for i in range(len(log)):
        odometry = log.odometry[i]
        if updated is not None:
            delta = odometry - updated
            delta[2] = float(wrap_angle(delta[2]))
            if not (np.abs(delta[:2]).max() > given["update_min_d"] or abs(delta[2]) > given["update_min_a"]):
                out[i] = compose(offset, odometry)
                continue
            _move(particles, delta, updated[2], alphas, rng)
        updated = odometry.copy()
        ranges = log.ranges[i, ::step].astype(np.float64)
        ranges[ranges <= range_min] = np.inf
        used = ranges < range_max  # nor what is no number
        ends = np.stack([ranges[used] * np.cos(angles[used]), ranges[used] * np.sin(angles[used])])
        converged = bool(np.abs(particles[:, :2] - particles[:, :2].mean(axis=0)).max() <= CONVERGED)
        skip = prob and given["do_beamskip"] and converged
        total = _weigh(
            particles, weights, ends + np.array(laser.pose[:2])[:, None], distances, 1.0 / grid.resolution,
            given["z_hit"], given["z_rand"] / range_max, given["sigma_hit"], field.distances[-1], prob,
            given["beam_skip_distance"] if skip else -1.0, given["beam_skip_threshold"],
            given["beam_skip_error_threshold"],
        )  # fmt: skip
        if total > 0.0:
            average = total / len(weights)
            weights /= total
            slow = average if slow == 0.0 else slow + given["recovery_alpha_slow"] * (average - slow)
            fast = average if fast == 0.0 else fast + given["recovery_alpha_fast"] * (average - fast)
        else:
            weights[:] = 1.0 / len(weights)
        count += 1
        if count % given["resample_interval"] == 0:
            share = max(0.0, 1.0 - fast / slow) if slow > 0.0 else 0.0
            particles = _resample(
                particles, weights, share, free, grid.resolution,
                given["min_particles"], most, given["pf_err"], given["pf_z"], rng,
            )  # fmt: skip
            weights = np.full(len(particles), 1.0 / len(particles))
            if share > 0.0:
                slow = fast = 0.0
            offset = compose(grid.to_map(_best_cluster(particles)), inverse(odometry))
        out[i] = compose(offset, odometry)
    return out


@njit(cache=True)
def _near_turn(angle):
    """How far an angle is from driving straight, forwards or backwards."""
    a = abs((angle + math.pi) % (2.0 * math.pi) - math.pi)
    return min(a, math.pi - a)


@njit(cache=True)
def _move(particles, delta, old_yaw, alphas, rng):
    trans = math.hypot(delta[0], delta[1])
    rot1 = 0.0 if trans < 0.01 else math.atan2(delta[1], delta[0]) - old_yaw
    rot2 = delta[2] - rot1
    n1, n2 = _near_turn(rot1), _near_turn(rot2)
    s1 = math.sqrt(alphas[0] * n1 * n1 + alphas[1] * trans * trans)
    s2 = math.sqrt(alphas[2] * trans * trans + alphas[3] * (n1 * n1 + n2 * n2))
    s3 = math.sqrt(alphas[0] * n2 * n2 + alphas[1] * trans * trans)
    for i in range(len(particles)):
        first = rot1 + rng.normal() * s1
        far = trans + rng.normal() * s2
        second = rot2 + rng.normal() * s3
        particles[i, 0] += far * math.cos(particles[i, 2] + first)
        particles[i, 1] += far * math.sin(particles[i, 2] + first)
        particles[i, 2] += first + second


@njit(cache=True)
def _weigh(particles, weights, ends, distances, per_cell, z_hit, z_rand, sigma, far, prob, near, agree, error):
    """Multiplies the weights by what the beams' ends say, and returns their sum; ``near`` < 0: no beam is skipped."""
    height, width = distances.shape
    n, m = len(particles), ends.shape[1]
    p = np.empty((n, m))
    close = np.zeros(m)
    for i in range(n):
        x, y, yaw = particles[i]
        cos, sin = math.cos(yaw), math.sin(yaw)
        for k in range(m):
            col = math.floor((x + cos * ends[0, k] - sin * ends[1, k]) * per_cell)
            row = math.floor((y + sin * ends[0, k] + cos * ends[1, k]) * per_cell)
            inside = 0 <= row < height and 0 <= col < width
            d = distances[row, col] if inside else far
            if inside and d < near:
                close[k] += 1
            p[i, k] = z_hit * math.exp(-d * d / (2.0 * sigma * sigma)) + z_rand
    kept = close / n > agree if near >= 0.0 else np.ones(m, np.bool_)
    if m - kept.sum() >= error * m:
        kept[:] = True
    total = 0.0
    for i in range(n):
        if prob:
            said = 0.0
            for k in range(m):
                if kept[k]:
                    said += math.log(p[i, k])
            weights[i] *= math.exp(said)
        else:
            said = 1.0
            for k in range(m):
                said += p[i, k] ** 3
            weights[i] *= said
        total += weights[i]
    return total


@njit(cache=True)
def _key(pose):
    return (
        np.int64(math.floor(pose[0] / BIN[0])),
        np.int64(math.floor(pose[1] / BIN[1])),
        np.int64(math.floor(pose[2] / BIN[2])),
    )


@njit(cache=True)
def _limit(bins, least, most, err, z):
    if bins <= 1:
        return most
    b = 2.0 / (9.0 * (bins - 1))
    x = 1.0 - b + math.sqrt(b) * z
    return min(most, max(least, int(math.ceil((bins - 1) / (2.0 * err) * x * x * x))))


@njit(cache=True)
def _resample(particles, weights, share, free, resolution, least, most, err, z, rng):
    cumulative = np.cumsum(weights)
    out = np.empty((most, 3))
    bins = {(np.int64(0), np.int64(0), np.int64(0))}
    bins.clear()
    n = 0
    while n < most:
        if rng.random() < share:
            row, col = free[rng.integers(0, len(free))]
            out[n, 0], out[n, 1] = (col + 0.5) * resolution, (row + 0.5) * resolution
            out[n, 2] = (2.0 * rng.random() - 1.0) * math.pi
        else:
            drawn = np.searchsorted(cumulative, rng.random() * cumulative[-1], side="right")
            out[n] = particles[min(drawn, len(particles) - 1)]
        bins.add(_key(out[n]))
        n += 1
        if n > _limit(len(bins), least, most, err, z):
            break
    return out[:n].copy()


@njit(cache=True)
def _best_cluster(particles):
    """Mean of the particles in the heaviest heap of bins that touch."""
    number = {(np.int64(0), np.int64(0), np.int64(0)): 0}
    number.clear()
    of = np.empty(len(particles), np.int64)
    keys = np.empty((len(particles), 3), np.int64)
    for i in range(len(particles)):
        key = _key(particles[i])
        if key not in number:
            keys[len(number)] = key
            number[key] = len(number)
        of[i] = number[key]
    k = len(number)
    label = np.full(k, -1)
    heaps = 0
    stack = np.empty(k, np.int64)
    for first in range(k):
        if label[first] >= 0:
            continue
        label[first], top, stack[0] = heaps, 1, first
        while top:
            top -= 1
            at = stack[top]
            for dx in range(-1, 2):
                for dy in range(-1, 2):
                    for dt in range(-1, 2):
                        beside = (keys[at, 0] + dx, keys[at, 1] + dy, keys[at, 2] + dt)
                        if beside in number and label[number[beside]] < 0:
                            label[number[beside]] = heaps
                            stack[top] = number[beside]
                            top += 1
        heaps += 1
    weight = np.zeros(heaps)
    for i in range(len(particles)):
        weight[label[of[i]]] += 1.0
    best = np.argmax(weight)
    sums = np.zeros(4)
    for i in range(len(particles)):
        if label[of[i]] == best:
            sums[0] += particles[i, 0]
            sums[1] += particles[i, 1]
            sums[2] += math.cos(particles[i, 2])
            sums[3] += math.sin(particles[i, 2])
    return np.array([sums[0] / weight[best], sums[1] / weight[best], math.atan2(sums[3], sums[2])])


def main() -> None:
    """Runs every file over every log, and prints a row for each of both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--log", nargs=2, action="append", required=True, metavar=("LOG", "TRUTH"))
    parser.add_argument("--file", action="append", required=True, help="nav2's parameter file, or: default")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--laser-truth", action="store_true", help="TRUTH has the poses of the laser")
    parser.add_argument("--until", type=float, help="s: no more of the log than that")
    asked = parser.parse_args()
    print("| log | file | scans right, all runs | worst run | median error (m) | p95 (m) | median (deg) |")
    print("|-----|------|----------------------:|----------:|-----------------:|--------:|-------------:|")
    for path, truth_path in asked.log:
        log = read_log(path)
        if asked.until is not None:
            log = log.part(slice(int(np.searchsorted(log.times, asked.until))))
        reference = read_tum(truth_path)
        truth = interpolate(laser_to_base(reference, log.laser.pose) if asked.laser_truth else reference, log.stamps)
        known = np.flatnonzero(~np.isnan(truth[:, 0]))
        log, truth = log.part(slice(known[0], known[-1] + 1)), truth[known[0] : known[-1] + 1]
        for file in asked.file:
            rows = []
            for seed in range(asked.runs):
                position, heading = pose_errors(run(log, _given(file), truth[0], seed), truth)
                right = float(is_localized(position, heading).mean())
                rows.append((right, np.median(position), np.quantile(position, 0.95), np.degrees(np.median(heading))))
            right, *errors = np.array(rows).T
            middle = " | ".join(f"{np.median(e):.{digits}f}" for e, digits in zip(errors, (3, 2, 1), strict=True))
            name = file if file == "default" else Path(file).name
            print(f"| {log.name} | {name} | {100 * right.mean():.1f} % | {100 * right.min():.1f} % | {middle} |")


def _given(file: str) -> dict[str, Any]:
    """AMCL's parameters by name: what the file says, and nav2's defaults for the rest."""
    if file == "default":
        return dict(DEFAULTS)
    values = given_in(YAML(typ="safe").load(Path(file)), file)
    assert values is not None, "no parameters of AMCL in this file"
    return {name: values.get(name) for name in DEFAULTS}


if __name__ == "__main__":
    main()
