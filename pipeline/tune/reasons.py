"""From which numbers in the logs each learned value comes, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.tune.drift import DRIFTS
from pipeline.tune.motion import ALPHAS

if TYPE_CHECKING:
    from pipeline.tune.learning import Tuning

HITS = 0.4
"""m: readings so close to the map's range are told of as those of the wall."""


@dataclass(frozen=True)
class Reason:
    """Why a parameter of this ``name`` has its ``value``: a sentence with the ``numbers`` that it was learned from."""

    name: str
    value: Any
    text: str
    numbers: Mapping[str, float]

    def to_dict(self) -> dict[str, Any]:
        """As plain values; a number that no log told is null."""
        told = {name: value if np.isfinite(value) else None for name, value in self.numbers.items()}
        return {**asdict(self), "numbers": told}


def explain(tuning: Tuning) -> tuple[Reason, ...]:
    """A reason for every parameter that `mcl tune` learns, in the order of its table."""
    return (*_of_beams(tuning), *_of_places(tuning), *_of_wheels(tuning), *_of_laser_odometry(tuning))


def _of_beams(tuning: Tuning) -> Iterator[Reason]:
    """The beam model's: counts of where beams ended, beside the share that the fit gives to each cause."""
    after, n = tuning.after, tuning.beams
    assert after.range_bias is not None
    raw = np.concatenate([r.residuals() for r in tuning.readings])
    beyond = raw - after.range_bias
    missing = sum(int(np.isinf(r.measured).sum()) for r in tuning.readings)
    reach = 2.0 * after.sigma_hit
    counts = {
        "hit": int((np.abs(beyond) <= reach).sum()),
        "short": int((beyond < -reach).sum()),
        "long": int((beyond > reach).sum()),
    }
    of_all = f"of {n:,} beams at {tuning.scans:,} scans"

    def share(name: str, cause: str, where: str) -> Reason:
        text = f"{counts[cause]:,} {of_all} ended {where}; the fit puts {100 * getattr(after, name):.1f} % down to that"
        return Reason(name, getattr(after, name), text, {"beams": n, "ended_there": counts[cause]})

    yield share("z_hit", "hit", f"within {reach:.2f} m of the wall that the map has")
    yield share("z_short", "short", f"more than {reach:.2f} m before it")
    yield share("z_long", "long", f"more than {reach:.2f} m behind it")
    text = f"{100 * after.z_rand:.1f} % {of_all} fit no other cause, and are spread over all ranges"
    yield Reason("z_rand", after.z_rand, text, {"beams": n})
    text = f"{missing:,} {of_all} came back from nowhere"
    yield Reason("z_max", after.z_max, text, {"beams": n, "without_return": missing})
    near = raw[np.abs(raw - after.range_bias) < HITS]
    spread = float(np.std(near)) if len(near) else float("nan")
    text = (
        f"{len(near):,} beams that ended within {HITS:g} m of the wall deviate by {spread:.3f} m; the fit counts only "
        "what no other cause explains better"
    )
    yield Reason("sigma_hit", after.sigma_hit, text, {"beams": len(near), "deviation": spread})
    for name, cause, side in (("lambda_short", "short", "before"), ("lambda_long", "long", "behind")):
        far = np.abs(beyond[beyond < -reach] if cause == "short" else beyond[beyond > reach])
        mean = float(far.mean()) if len(far) else float("nan")
        text = f"{len(far):,} beams ended more than {reach:.2f} m {side} the wall, {mean:.2f} m on average"
        yield Reason(name, getattr(after, name), text, {"beams": len(far), "mean_distance": mean})
    median = float(np.median(near)) if len(near) else float("nan")
    text = f"those {len(near):,} beams are longer than the map says by {median:.3f} m (median)"
    yield Reason("range_bias", after.range_bias, text, {"beams": len(near), "median": median})


def _of_places(tuning: Tuning) -> Iterator[Reason]:
    tried = sorted(tuning.thresholds, key=lambda pair: -pair[1])
    best, second = tried[0], tried[1]
    text = (
        f"of {len(tried)} thresholds tried, the model with this one best predicts the scans held out: {best[1]:.2f} "
        f"nats a scan; with the next, {second[0]:g}, it is {second[1]:.2f}"
    )
    numbers = {"tried": len(tried), "nats": best[1], "nats_of_next": second[1]}
    yield Reason("occupied_threshold", tuning.after.occupied_threshold, text, numbers)
    windows = np.concatenate(list(tuning.rivals))
    best_place = float(np.mean(windows.argmax(axis=1) == 0)) if len(windows) else float("nan")
    text = (
        f"over {len(windows):,} stretches of 0.2 m, with all beams counted in full, the right place is likelier than "
        f"{windows.shape[1] - 1} rivals in {100 * best_place:.0f} %; so many are as sure as they are right"
    )
    numbers = {"stretches": len(windows), "right": best_place}
    yield Reason("independent_beams", tuning.after.independent_beams, text, numbers)


def _of_wheels(tuning: Tuning) -> Iterator[Reason]:
    rows = tuning.driven
    kept = any(remark.startswith("alpha1") for remark in tuning.remarks)
    heading, along = rows.T[:2] if len(rows) else np.zeros((2, 1))
    numbers = {
        "windows": len(rows),
        "heading_error": float(np.sqrt(np.mean(np.square(heading)))),
        "way_error": float(np.sqrt(np.mean(np.square(along)))),
    }
    for name in ALPHAS:
        value = getattr(tuning.after, name)
        if kept:
            yield Reason(name, value, f"not learned: {len(rows)} windows of driving are too few", numbers)
            continue
        of_heading = name in ("alpha1", "alpha2")
        error = f"{np.degrees(numbers['heading_error']):.2f} deg" if of_heading else f"{numbers['way_error']:.3f} m"
        per = "turning" if name in ("alpha1", "alpha4") else "driving"
        what = "heading" if of_heading else "the way"
        text = (
            f"over {len(rows):,} windows of 0.5 to 1.5 m the wheels err by {error} of {what} (RMS); this is the part "
            f"of its square that grows with {per}"
        )
        yield Reason(name, value, text, numbers)


def _of_laser_odometry(tuning: Tuning) -> Iterator[Reason]:
    rows = tuning.drift.windows
    held = ~np.isnan(rows[:, 1])
    for k, (name, unit, jitter) in enumerate(zip(DRIFTS, ("m", "rad"), tuning.drift.jitter, strict=True)):
        windows = int(held.sum()) if k == 0 else len(rows)
        value = getattr(tuning.after, name)
        numbers = {"windows": windows, "jitter": float(np.sqrt(jitter)) if jitter >= 0.0 else float("nan")}
        if np.isnan(jitter):
            yield Reason(name, value, f"not learned: {windows} windows of 2 to 16 m are too few", numbers)
            continue
        text = (
            f"over {windows:,} windows of 2 to 16 m the laser's odometry and hindsight come apart so quickly; "
            f"{numbers['jitter']:.3f} {unit} between them do not grow with the way"
        )
        yield Reason(name, value, text, numbers)
