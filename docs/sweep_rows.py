"""The rows of docs/sweep.py: which log, which map and truth, and what is asked of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

END = 100_000
"""s: after the end of any log."""


@dataclass(frozen=True)
class Row:
    """A row of the table: a log and how it is made, its map and truth, and what is asked of it.

    Paths are below the folder of the data, or ``sample/...`` of this checkout. ``convert`` and ``evaluate``: options of
    these commands; ``thin``: of a CARMEN log, only a scan per so many metres of the true path; ``map_now``: a map to
    localize in, instead of the one that the log carries.
    """

    name: str
    logs: tuple[str, ...]
    map: str
    truth: tuple[str, ...]
    convert: tuple[str, ...] = ()
    evaluate: tuple[str, ...] = ()
    thin: float | None = None
    map_now: str = ""


def _drops(*intervals: tuple[float, float]) -> tuple[str, ...]:
    return tuple(word for begin, end in intervals for word in ("--drop", f"{begin:g}:{end:g}"))


def _window(begin: float, seconds: float = 120.0) -> tuple[str, ...]:
    """Only so many seconds, from ``begin`` on."""
    after = (begin + seconds, END)
    return _drops((0, begin), after) if begin else _drops(after)


def _wean(number: int) -> Row:
    name = f"robotdata{number}"
    return Row(name, (f"cmu/{name}.log.gz",), "cmu/wean.dat.gz", (f"cmu/reference/{name}.tum",))


def _carmen(name: str) -> Row:
    folder = f"carmen/{name}"
    truth = (f"{folder}/groundtruth.tum",)
    return Row(name, (f"{folder}/{name}.log.gz",), f"{folder}/map.yaml", truth, evaluate=("--reference-frame", "laser"))


def _blind(row: Row) -> Row:
    return replace(row, name=f"{row.name}, no odometry", convert=(*row.convert, "--without-odometry"))


def _wrong(row: Row, *asked: str) -> Row:
    """The row with faults made in every run: options of evaluate."""
    return replace(row, name=f"{row.name}, {' '.join(asked).removeprefix('--')}", evaluate=(*row.evaluate, *asked))


def rows() -> list[Row]:
    """All rows, in the order of the tables."""
    one, two, four = (_wean(number) for number in (1, 2, 4))
    intel, fr079, aces = (_carmen(name) for name in ("intel", "fr079", "aces"))
    joined = replace(
        one,
        name="robotdata1 + robotdata4",
        logs=one.logs + four.logs,
        truth=one.truth + four.truth,
        convert=("--join",),
    )
    carried: list[tuple[Row, tuple[tuple[float, float], ...]]] = [
        (two, ((30, 60),)),
        (four, ((20, 35),)),
        (one, ((20, 35), (80, 110))),
        (one, ((30, 60),)),
    ]
    dropped = [
        replace(row, name=f"{row.name} without {' s, '.join(f'{a:g}-{b:g}' for a, b in gaps)} s", convert=_drops(*gaps))
        for row, gaps in carried
    ]
    windows = [
        replace(row, name=f"{row.name}, 120 s from {begin:g} s", convert=_window(begin))
        for row in (intel, fr079, aces)
        for begin in (0.0, 300.0, 600.0)
    ]
    early = [
        replace(
            row,
            name=f"{row.name}, 120 s from {begin:g} s, early map",
            map=row.map.replace("map.yaml", "map_early/map.yaml"),
            convert=_window(begin),
        )
        for row, begins in ((intel, (809.0, 1109.0)), (fr079, (532.0, 832.0)), (aces, (1018.0, 1318.0)))
        for begin in begins
    ]
    robots = "uob_pioneer"
    pioneer = Row("Pioneer", (f"{robots}/trace0.bag",), f"{robots}/map.yaml", (f"{robots}/trace0_groundtruth.tum",))
    olin = "olin_mac"
    others = [
        pioneer,
        replace(pioneer, name="Pioneer, map of the other drive", map_now=f"{robots}/map_from_trace1/map.yaml"),
        Row(
            "Olin", (f"{olin}/macfirst_floor_take_2",), f"{olin}/mac_1st_floor_9_23.yaml", (f"{olin}/groundtruth.tum",)
        ),
        Row("office", ("sample/office.log.gz",), "sample/office.dat.gz", ("sample/office_truth.tum",)),
    ]
    thinned = [
        replace(_blind(row), name=f"{row.name}, no odometry, a scan per {metres:g} m", thin=metres)
        for row in (intel, fr079)
        for metres in (1.0, 3.0)
    ]
    whole = [one, two, four, intel, fr079, aces]
    passing = [
        _wrong(row, "--fault", kind)
        for kind in ("gap", "turn", "slide", "spin")
        for row in (one, two, four, intel, aces)
    ]
    lasting = [
        _wrong(row, "--fault", kind)
        for kind in ("dead", "mirrored", "no-reverse", "scale:0.7", "restart", "late:0.3")
        for row in (one, four, intel, aces)
    ]
    failures = [_wrong(row, "--failures", "0.3" if row in whole[:3] else "0.02") for row in whole]
    seen = [one, four, *(row for row in windows if "120 s from 0 s" in row.name and not row.name.startswith("aces"))]
    changed = [
        _wrong(row, "--perturb-map", change)
        for row in seen
        for change in (
            *("0.05", "0.1", "0.2", "0.4"),
            *(f"{kind}:0.2" for kind in ("doors", "shut", "erased", "unknown", "boxes", "moved")),
        )
    ]
    return [
        *whole[:3],
        *dropped[:2],
        joined,
        *dropped[2:],
        *whole[3:],
        *windows,
        *early,
        *others,
        *(_blind(row) for row in (intel, fr079, aces, one, two, four)),
        *thinned,
        *passing,
        *lasting,
        *failures,
        *changed,
    ]
