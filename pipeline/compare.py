"""Runs side by side: their figures, what differs in their configurations, and where their estimates part."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluate.metrics import pose_errors
from pipeline.export.run import Run, differing
from pipeline.outputs import check_output, check_suffix, replacing

if TYPE_CHECKING:
    from pipeline.recording.side_by_side import Apart, Shown

APART = 0.5
"""Metres between two estimates from which on they are said to part."""
APART_TURN = float(np.deg2rad(10.0))
"""Radians, likewise."""


@dataclass(frozen=True)
class Figures:
    """What came out of a run; None where it is not known.

    Times are s of the log but for ``wall``, which is s of the machine; errors are m against the truth as drawn (4 mm),
    ``error`` the median from convergence on, None if that never came; ``explained`` is a share of the beams.
    """

    log: str
    seed: int
    scans: int
    duration: float
    converged_at: float | None
    lost: int
    found: int
    explained: float | None
    error: float | None
    end_error: float | None
    particles: int | None
    wall: float | None


def figures(run: Run) -> Figures:
    """What the recording alone tells."""
    told, scenes = run.told, run.scenes
    kinds = [event.kind for event in told.events]
    converged = told.converged_at is not None
    since = told.times >= (told.converged_at or 0.0)
    error = errors(run)[0]
    known = error[since & ~np.isnan(error) & converged]
    explained, particles = scenes.curves["explained"][since], scenes.curves["particles"][-1]
    return Figures(
        log=told.log,
        seed=told.seed,
        scans=told.scans,
        duration=told.duration,
        converged_at=told.converged_at,
        lost=kinds.count("lost"),
        found=kinds.count("found"),
        explained=float(np.nanmean(explained)) if (~np.isnan(explained)).any() else None,
        error=float(np.median(known)) if len(known) else None,
        end_error=None if np.isnan(error[-1]) else float(error[-1]),
        particles=None if np.isnan(particles) else int(particles),
        wall=sum(told.timings.values()) or None,
    )


FIGURES: tuple[tuple[str, Callable[[Figures], str]], ...] = (
    ("scans", lambda f: f"{f.scans:,}"),
    ("duration", lambda f: f"{f.duration:.1f} s"),
    ("converged", lambda f: "never" if f.converged_at is None else f"{f.converged_at:.1f} s"),
    ("times lost", lambda f: f"{f.lost}"),
    ("times found again", lambda f: f"{f.found}"),
    ("explained", lambda f: _or_dash(f.explained, lambda v: f"{100 * v:.0f} %")),
    ("error", lambda f: _or_dash(f.error, lambda v: f"{v:.2f} m")),
    ("at the end", lambda f: _or_dash(f.end_error, lambda v: f"{v:.2f} m")),
    ("particles", lambda f: _or_dash(f.particles, lambda v: f"{v:,}")),
    ("wall", lambda f: _or_dash(f.wall, lambda v: f"{v:.1f} s")),
)
"""What is told of a run, and how."""


@dataclass(frozen=True)
class Stretch:
    """From ``begin`` to ``end``, s, two estimates were apart: by ``distance`` m and ``turn`` rad at its beginning, and
    by ``most`` m at the worst."""

    begin: float
    end: float
    distance: float
    turn: float
    most: float


@dataclass(frozen=True)
class Comparison:
    """Two runs side by side.

    ``figures`` of each; ``config``: what differs in their parameters, (value, value) by name, None where one lacks it;
    ``same_log``, ``same_map``; ``common``: how many scans they share, by stamp, and ``apart`` when they stood at
    different poses, in the order of time; ``scans``, ``times`` (s) and ``distances`` (m) (n,): of the common scans.
    """

    figures: tuple[Figures, Figures]
    config: dict[str, tuple[Any, Any]]
    same_log: bool
    same_map: bool
    apart: tuple[Stretch, ...]
    scans: NDArray[np.int64]
    times: NDArray[np.float64]
    distances: NDArray[np.float64]

    def __repr__(self) -> str:
        a, b = self.figures
        apart = f"apart in {len(self.apart)} stretches" if self.apart else "never apart"
        names = f"{a.log}, seed {a.seed} and {b.log}, seed {b.seed}"
        return f"Comparison({names}: {self.common:,} common scans, {apart}, {len(self.config)} parameters differ)"

    @property
    def common(self) -> int:
        """Scans of the same stamp."""
        return len(self.times)

    def to_dict(self) -> dict[str, Any]:
        """As plain values."""
        a, b = self.figures
        return {
            "a": asdict(a),
            "b": asdict(b),
            "same_log": self.same_log,
            "same_map": self.same_map,
            "config": {name: {"a": values[0], "b": values[1]} for name, values in self.config.items()},
            "common_scans": self.common,
            "apart": [asdict(stretch) for stretch in self.apart],
            "distance": {
                "median": float(np.median(self.distances)) if self.common else None,
                "most": float(np.max(self.distances)) if self.common else None,
                "end": float(self.distances[-1]) if self.common else None,
            },
        }

    def config_rows(self) -> list[tuple[str, str, str]]:
        """Parameters that differ, as (name, value, value) texts."""
        return [(name, _shown(a), _shown(b)) for name, (a, b) in self.config.items()]

    def figure_rows(self) -> list[tuple[str, str, str]]:
        """Figures as (name, value, value) texts."""
        a, b = self.figures
        rows = [("log", a.log, b.log), ("seed", str(a.seed), str(b.seed))]
        return [*rows, *((name, show(a), show(b)) for name, show in FIGURES if (show(a), show(b)) != ("-", "-"))]

    def apart_rows(self) -> list[tuple[str, str, str]]:
        """When the estimates were apart, as texts: from when to when, how far at first, and at the worst."""
        return [
            (f"{s.begin:.1f} s", f"to {s.end:.1f} s", f"{s.distance:.2f} m, {np.degrees(s.turn):.0f} deg; "
             f"at the worst {s.most:.2f} m")
            for s in self.apart
        ]  # fmt: skip


def compare(a: Run, b: Run) -> Comparison:
    """What differs between two runs; their estimates at the scans that both have, told apart by the stamps."""
    _, left, right = np.intersect1d(a.told.stamps, b.told.stamps, return_indices=True)
    position, turn = pose_errors(a.told.poses[left], b.told.poses[right])
    times = a.told.times[left]
    return Comparison(
        figures=(figures(a), figures(b)),
        config=differing([a, b]),
        same_log=a.told.log_sha256 == b.told.log_sha256,
        same_map=a.told.map_sha256 == b.told.map_sha256,
        apart=_stretches(times, position, turn),
        scans=a.told.scan_indices[left],
        times=times,
        distances=position,
    )


def table(runs: Sequence[Run]) -> dict[str, tuple[str, ...]]:
    """A text for every run by what it tells: log and seed, the parameters that differ, and figures known of any."""
    told = [figures(run) for run in runs]
    rows = {"log": tuple(one.log for one in told), "seed": tuple(str(one.seed) for one in told)}
    rows |= {name: tuple(map(_shown, values)) for name, values in differing(runs).items()}
    shown = {label: tuple(show(one) for one in told) for label, show in FIGURES}
    return rows | {label: texts for label, texts in shown.items() if set(texts) != {"-"}}


def record(runs: Sequence[Run], output: Path, *, force: bool = False) -> None:
    """Write one recording that shows the runs on the same time line; of one run a whole copy, whatever its damage.

    Raises MclError as `write_side_by_side`, or if ``output`` exists and ``force`` does not say to replace it.
    """
    from pipeline.recording.side_by_side import write_run, write_side_by_side

    check_output(output, force)
    check_suffix(output, ".rrd", "the name of a recording ends in .rrd")
    with replacing(output) as partial:
        if len(runs) == 1:
            write_run(partial, _to_show(runs)[0])
        else:
            write_side_by_side(partial, _to_show(runs), apart=_distance(runs))


def send(runs: Sequence[Run], address: str) -> None:
    """Show a run, or several side by side, in the viewer at ``address``. Raises MclError if it takes nothing."""
    from pipeline.recording.side_by_side import send_run, send_side_by_side

    if len(runs) == 1:
        send_run(address, _to_show(runs)[0])
    else:
        send_side_by_side(address, _to_show(runs), apart=_distance(runs))


def _to_show(runs: Sequence[Run]) -> list[Shown]:
    from pipeline.recording.side_by_side import Shown

    return [Shown(f"{run.name}, seed {run.seed}", run.file, run.scenes) for run in runs]


def _distance(runs: Sequence[Run]) -> Apart | None:
    if len(runs) != 2:
        return None
    found = compare(*runs)
    return (found.scans, found.times, found.distances) if found.common else None


def errors(run: Run) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position (m) and heading (rad) error of every scan, (n,) each; NaN where the truth is not known."""
    return pose_errors(run.scenes.estimates, run.scenes.truth)


def _or_dash(value: float | None, show: Callable[[float], str]) -> str:
    return "-" if value is None else show(value)


def _stretches(
    times: NDArray[np.float64], position: NDArray[np.float64], turn: NDArray[np.float64]
) -> tuple[Stretch, ...]:
    apart = (position > APART) | (turn > APART_TURN)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], apart, [False]])))
    return tuple(
        Stretch(
            float(times[begin]),
            float(times[end - 1]),
            float(position[begin]),
            float(turn[begin]),
            float(position[begin:end].max()),
        )
        for begin, end in edges.reshape(-1, 2)
    )


def _shown(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:g}" if isinstance(value, float) else str(value)
