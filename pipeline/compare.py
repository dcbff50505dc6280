"""Runs side by side: their figures, what differs in their configurations, and where their estimates part."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from string import ascii_uppercase
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.evaluate.metrics import interpolate, pose_errors
from pipeline.export.run import Run, differing, read_run
from pipeline.logs.messages import Trajectory
from pipeline.logs.tum import read_tum
from pipeline.outputs import check_output, check_suffix, replacing
from pipeline.recording.rrd_file import MAGIC

if TYPE_CHECKING:
    from pipeline.recording.side_by_side import Apart, Shown, Way

APART = 0.5
"""Metres between two estimates from which on they are said to part."""
APART_TURN = float(np.deg2rad(10.0))
"""Radians, likewise."""

MOST = 6
"""Runs and tracks that are told apart in one comparison: so many colours there are."""


@dataclass(frozen=True)
class Track:
    """Where another filter, AMCL for instance, has the robot: its ``name``, that of a TUM file, and the ``trajectory``
    of base_link in the map's frame."""

    name: str
    trajectory: Trajectory

    def __repr__(self) -> str:
        return f"Track({self.name!r}: {len(self.trajectory.stamps):,} poses)"


Compared = Run | Track


def read_compared(paths: Sequence[Path]) -> list[Compared]:
    """Runs, by their folders or recordings, and tracks, by their TUM files; told apart by what they hold.

    Raises MclError for what is neither, if the first is no run, if there are more than ``MOST``, or if a track has no
    pose within the time of the first run.
    """
    if len(paths) > MOST:
        raise MclError(f"at most {MOST} are compared with each other, {len(paths)} were given")
    found = [_read_one(path) for path in paths]
    if isinstance(found[0], Track):
        raise MclError("the first one is a run, which has the map and the scans", "name it first", path=paths[0])
    for path, one in zip(paths, found, strict=True):
        if isinstance(one, Track) and not len(compare(found[0], one).times):
            raise MclError(
                "no pose of this file is of the time of the first run", "are its stamps those of the log?", path=path
            )
    return found


def _read_one(path: Path) -> Compared:
    if path.is_file() and path.suffix != ".rrd":
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                return Track(path.name, read_tum(path))
    return read_run(path)


@dataclass(frozen=True)
class Figures:
    """What came out of a run or a track; None where it is not known.

    Times are s of the log but for ``wall``, which is s of the machine; errors are m against the truth as drawn (4 mm),
    ``error`` the median from convergence on, None if that never came; ``explained`` is a share of the beams.
    """

    log: str
    seed: int | None
    scans: int
    duration: float
    converged_at: float | None
    lost: int | None
    found: int | None
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


def track_figures(track: Track, beside: Run) -> Figures:
    """What is known of another filter's way: against the truth of the run, at its scans."""
    at = _common(beside, track)[0]
    error = track_errors(track, beside)[0]
    since = beside.told.times[at] >= (beside.told.converged_at or 0.0)  # as of the run, so that the two are alike
    known = error[since & ~np.isnan(error)]
    return Figures(
        log=track.name,
        seed=None,
        scans=len(at),
        duration=float(np.ptp(beside.told.times[at])) if len(at) else 0.0,
        converged_at=None,
        lost=None,
        found=None,
        explained=None,
        error=float(np.median(known)) if len(known) else None,
        end_error=float(error[-1]) if len(known) and not np.isnan(error[-1]) else None,
        particles=None,
        wall=None,
    )


FIGURES: tuple[tuple[str, Callable[[Figures], str]], ...] = (
    ("scans", lambda f: f"{f.scans:,}"),
    ("duration", lambda f: f"{f.duration:.1f} s"),
    ("converged", lambda f: "-" if f.lost is None else _or_dash(f.converged_at, lambda v: f"{v:.1f} s", "never")),
    ("times lost", lambda f: _or_dash(f.lost, str)),
    ("times found again", lambda f: _or_dash(f.found, str)),
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
    """Two runs side by side, or a run and a track.

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

    def apart_rows(self) -> list[tuple[str, str, str]]:
        """When the estimates were apart, as texts: from when to when, how far at first, and at the worst."""
        return [
            (f"{s.begin:.1f} s", f"to {s.end:.1f} s", f"{s.distance:.2f} m, {np.degrees(s.turn):.0f} deg; "
             f"at the worst {s.most:.2f} m")
            for s in self.apart
        ]  # fmt: skip


def compare(a: Run, b: Run | Track) -> Comparison:
    """What differs between two runs, or a run and a track; their estimates at the scans that both have, told apart by
    the stamps. Between the poses of a track the way is taken as straight."""
    left, at_a, at_b = _common(a, b)
    position, turn = pose_errors(at_a, at_b)
    times = a.told.times[left]
    told = figures(b) if isinstance(b, Run) else track_figures(b, a)
    other = b if isinstance(b, Run) else a
    return Comparison(
        figures=(figures(a), told),
        config=differing([a, b]) if isinstance(b, Run) else {},
        same_log=a.told.log_sha256 == other.told.log_sha256,
        same_map=a.told.map_sha256 == other.told.map_sha256,
        apart=_stretches(times, position, turn),
        scans=a.told.scan_indices[left],
        times=times,
        distances=position,
    )


def _common(a: Run, b: Compared) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """The rows of ``a`` at which ``b`` says something as well, and the poses of both there, (n, 3) each."""
    if isinstance(b, Run):
        _, left, right = np.intersect1d(a.told.stamps, b.told.stamps, return_indices=True)
        return left, a.told.poses[left], b.told.poses[right]
    poses = interpolate(b.trajectory, a.told.stamps)
    rows = np.flatnonzero(~np.isnan(poses[:, 0]))
    return rows, a.told.poses[rows], poses[rows]


def config_rows(compared: Sequence[Compared]) -> list[tuple[str, ...]]:
    """The parameters that differ, as texts: the name, and everyone's value."""
    configs = [one.told.config if isinstance(one, Run) else {} for one in compared]
    names = differing([one for one in compared if isinstance(one, Run)])
    return [(name, *(_shown(config.get(name)) for config in configs)) for name in names]


def figure_rows(compared: Sequence[Compared]) -> list[tuple[str, ...]]:
    """What is known of any, as texts: what it is, and everyone's, beginning with log and seed.

    Tracks are held against the truth of the first run.
    """
    first = next(one for one in compared if isinstance(one, Run))
    told = [figures(one) if isinstance(one, Run) else track_figures(one, first) for one in compared]
    shown = [(label, *(show(one) for one in told)) for label, show in FIGURES]
    rows = [("log", *(one.log for one in told)), ("seed", *(_shown(one.seed) for one in told)), *shown]
    return [row for row in rows if set(row[1:]) != {"-"}]


def table(compared: Sequence[Compared]) -> dict[str, tuple[str, ...]]:
    """A text for everyone by what it tells: log and seed, the parameters that differ, and figures known of any."""
    log, seed, *known = figure_rows(compared)
    return {name: tuple(texts) for name, *texts in (log, seed, *config_rows(compared), *known)}


def record(compared: Sequence[Compared], output: Path, *, force: bool = False) -> None:
    """Write one recording that shows runs on the same time line, and the ways of tracks on the map of the first run;
    of one run a whole copy, whatever its damage.

    Raises MclError as `write_side_by_side`, or if ``output`` exists and ``force`` does not say to replace it.
    """
    from pipeline.recording.side_by_side import Shown, write_run, write_side_by_side

    check_output(output, force)
    check_suffix(output, ".rrd", "name a page .html or a recording .rrd")
    shown = _to_show(compared)
    with replacing(output) as partial:
        if len(shown) == 1 and isinstance(shown[0], Shown):
            write_run(partial, shown[0])
        else:
            write_side_by_side(partial, shown, apart=_distances(compared))


def send(runs: Sequence[Run], address: str) -> None:
    """Show a run, or several side by side, in the viewer at ``address``. Raises MclError if it takes nothing."""
    from pipeline.recording.side_by_side import Shown, send_run, send_side_by_side

    shown = _to_show(runs)
    if len(shown) == 1 and isinstance(shown[0], Shown):
        send_run(address, shown[0])
    else:
        send_side_by_side(address, shown, apart=_distances(runs))


def _to_show(compared: Sequence[Compared]) -> list[Shown | Way]:
    from pipeline.recording.side_by_side import Shown, Way

    shown: list[Shown | Way] = []
    for one in compared:
        if isinstance(one, Run):
            shown.append(Shown(f"{one.name}, seed {one.seed}", one.file, one.scenes))
        else:
            first = next(run for run in compared if isinstance(run, Run))
            rows, _, poses = _common(first, one)
            shown.append(Way(one.name, first.told.scan_indices[rows], first.told.times[rows], poses))
    return shown


def _distances(compared: Sequence[Compared]) -> dict[str, Apart]:
    """Of everyone but the first, by their letters, where they have scans in common with it."""
    first, *others = compared
    assert isinstance(first, Run)
    pairs = zip(ascii_uppercase[1:], (compare(first, other) for other in others), strict=False)
    return {letter: (found.scans, found.times, found.distances) for letter, found in pairs if found.common}


def errors(run: Run) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position (m) and heading (rad) error of every scan, (n,) each; NaN where the truth is not known."""
    return pose_errors(run.scenes.estimates, run.scenes.truth)


def track_errors(track: Track, beside: Run) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position (m) and heading (rad) error of a track at the scans of a run at which it says something, against the
    truth of that run, (n,) each; NaN where the truth is not known."""
    rows, _, poses = _common(beside, track)
    return pose_errors(poses, beside.scenes.truth[rows])


def _or_dash(value: float | None, show: Callable[[float], str], dash: str = "-") -> str:
    return dash if value is None else show(value)


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
