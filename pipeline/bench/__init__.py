"""How fast: whole commands as a user runs them, and the kernels beside what anybody would write first."""

from __future__ import annotations

from pipeline.bench.measure import Benchmark, Row, machine
from pipeline.errors import MclError
from pipeline.logs.messages import Log

__all__ = ["Benchmark", "Row", "bench"]


def bench(log: Log, repeats: int = 5) -> Benchmark:
    """Measure everything over one log that has a map; each row is the median of so many repeats, after a first one.

    Raises MclError for a log without a map.
    """
    if log.grid is None:
        raise MclError("the log has no map", "convert it with --map", path=log.path)
    # Imported here: they load the compiled kernels.
    from pipeline.bench.commands import commands
    from pipeline.bench.growth import growth
    from pipeline.bench.scoring import scoring
    from pipeline.bench.tables import tables

    # Whole processes first: what they need in memory is theirs alone.
    whole = commands(log.path, repeats)
    rows = [*scoring(log, repeats), *tables(log, repeats), *whole]
    return Benchmark(*machine(), log.name, repeats, tuple(rows), tuple(growth(log, repeats)))
