"""One evaluation for each value of a parameter, side by side."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from pipeline.config import ALIASES, Config, check_name
from pipeline.errors import MclError
from pipeline.evaluate.aftermath import FAULT_COLUMNS, Row
from pipeline.evaluate.paired import PAIRED_COLUMNS, Paired, paired, paired_row
from pipeline.evaluate.perturbed import Change
from pipeline.evaluate.report import Evaluation, runs_frame
from pipeline.evaluate.tables import (
    AGREEMENT_COLUMNS,
    CERTAIN_COLUMNS,
    COLUMNS,
    RECOVERY_COLUMNS,
    agreement_table,
    certainty_table,
    change_table,
    compare_table,
    fault_table,
    recovery_table,
)

if TYPE_CHECKING:
    import pandas as pd

PER_METRE = "failures per metre"
"""What a comparison calls the rate of failures that it varies."""
MAP = "map"
"""What a comparison calls the changes of the map that it varies."""


@dataclass(frozen=True)
class Variant:
    """A configuration among others: ``values`` as they were typed, in the order of the parameters that are varied.

    ``failures``: so many are made a metre, if any; ``change``: of the map, if any.
    """

    values: tuple[str, ...]
    config: Config
    failures: float | None = None
    change: Change | None = None

    @property
    def label(self) -> str:
        """What tells it from the others."""
        return ", ".join(self.values)


@dataclass(frozen=True)
class Comparison:
    """``evaluations``: of the same logs and seeds, one for each of ``variants``, whose values of ``keys`` differ."""

    keys: tuple[str, ...]
    variants: tuple[Variant, ...]
    evaluations: tuple[Evaluation, ...]

    @property
    def labelled(self) -> list[tuple[str, Evaluation]]:
        """Each evaluation under the label of its variant."""
        return [(variant.label, done) for variant, done in zip(self.variants, self.evaluations, strict=True)]

    @property
    def columns(self) -> Row:
        """Headings of ``table``."""
        return (COLUMNS[0], ", ".join(self.keys), *COLUMNS[1:])

    def table(self) -> list[Row]:
        """Log by log, one row of strings per variant."""
        return compare_table(self.labelled)

    @property
    def recovery_columns(self) -> Row:
        """Headings of ``recovery_table``."""
        return (RECOVERY_COLUMNS[0], ", ".join(self.keys), *RECOVERY_COLUMNS[1:])

    def recovery_table(self) -> list[Row]:
        """Variant by variant, one row of strings per log and kidnapping."""
        return [(row[0], label, *row[1:]) for label, done in self.labelled for row in recovery_table(done)]

    @property
    def fault_columns(self) -> Row:
        """Headings of ``fault_table``."""
        return (FAULT_COLUMNS[0], ", ".join(self.keys), *FAULT_COLUMNS[1:])

    def fault_table(self) -> list[Row]:
        """Variant by variant, one row of strings per log and fault."""
        return [(row[0], label, *row[1:]) for label, done in self.labelled for row in fault_table(done)]

    def change_table(self) -> list[Row]:
        """Variant by variant, one row of strings per log, under CHANGE_COLUMNS."""
        return list(dict.fromkeys(row for done in self.evaluations for row in change_table(done)))

    def label_without(self, key: str, variant: Variant) -> str:
        """What tells a variant from those that differ in ``key`` only."""
        named = zip(self.keys, variant.values, strict=True)
        return ", ".join(f"{name}={value}" for name, value in named if name != key)

    @property
    def certain_columns(self) -> Row:
        """Headings of ``certainty_table``."""
        return (CERTAIN_COLUMNS[0], ", ".join(self.keys), *CERTAIN_COLUMNS[1:])

    def certainty_table(self) -> list[Row]:
        """Variant by variant, one row of strings per log."""
        return [(row[0], label, *row[1:]) for label, done in self.labelled for row in certainty_table(done)]

    @property
    def agreement_columns(self) -> Row:
        """Headings of ``agreement_table``."""
        return (AGREEMENT_COLUMNS[0], ", ".join(self.keys), *AGREEMENT_COLUMNS[1:])

    def agreement_table(self) -> list[Row]:
        """Variant by variant, one row of strings per log whose truth is not known."""
        return [(row[0], label, *row[1:]) for label, done in self.labelled for row in agreement_table(done)]

    @cached_property
    def paired(self) -> tuple[Paired, ...]:
        """Log by log, each variant but the first against the first one, seed by seed; of logs whose truth is known."""
        (_, first), *others = self.labelled
        return tuple(
            paired(log, other.logs[k], label)
            for k, log in enumerate(first.logs)
            for label, other in others
            if log.scored
        )

    @property
    def paired_columns(self) -> Row:
        """Headings of ``paired_table``."""
        return (PAIRED_COLUMNS[0], ", ".join(self.keys), *PAIRED_COLUMNS[1:])

    def paired_table(self) -> list[Row]:
        """One row of strings for each of ``paired``."""
        return [paired_row(each) for each in self.paired]

    def __repr__(self) -> str:
        labels, logs = "; ".join(variant.label for variant in self.variants), len(self.evaluations[0].logs)
        return f"Comparison({', '.join(self.keys)}: {labels}; {logs} {'log' if logs == 1 else 'logs'})"

    def to_pandas(self) -> pd.DataFrame:
        """A row per variant, log and seed: its values, what ``Run.to_dict`` tells. Raises MclError without pandas."""
        named = [dict(zip(self.keys, variant.values, strict=True)) for variant in self.variants]
        return runs_frame(list(zip(named, self.evaluations, strict=True)))

    def to_dict(self) -> dict[str, Any]:
        """As plain values, ready for JSON: what is varied, per variant its values and its evaluation, and how they
        compare seed by seed."""
        variants = []
        for variant, done in zip(self.variants, self.evaluations, strict=True):
            plain = done.to_dict()
            values = plain["config"] | {PER_METRE: done.failures, MAP: done.change and done.change.text}
            named = {key: values.get(key, typed) for key, typed in zip(self.keys, variant.values, strict=True)}
            variants.append({"values": named, **plain})
        return {"vary": list(self.keys), "variants": variants, "paired": [asdict(each) for each in self.paired]}


def with_failures(
    keys: tuple[str, ...], found: tuple[Variant, ...], rates: Sequence[float]
) -> tuple[tuple[str, ...], tuple[Variant, ...]]:
    """Every variant with each of these rates of failures per metre, which is told as one more key if there are several.

    Raises MclError for a rate that is none.
    """
    if not rates:
        return keys, found
    for rate in rates:
        if not 0.0 < rate < math.inf:
            raise MclError(f"--failures {rate:g}: expected a number of failures per metre, more than 0")
    if len(rates) == 1:
        return keys, tuple(replace(one, failures=rates[0]) for one in found)
    every = [
        replace(one, values=(f"{rate:g}", *one.values), failures=rate) for rate in dict.fromkeys(rates) for one in found
    ]
    return (PER_METRE, *keys), tuple(every)


def with_changes(
    keys: tuple[str, ...], found: tuple[Variant, ...], changes: Sequence[Change]
) -> tuple[tuple[str, ...], tuple[Variant, ...]]:
    """Every variant with each of these changes of the map, which are told as one more key if there are several."""
    if not changes:
        return keys, found
    if len(changes) == 1:
        return keys, tuple(replace(one, change=changes[0]) for one in found)
    every = [
        replace(one, values=(change.text, *one.values), change=change)
        for change in dict.fromkeys(changes)
        for one in found
    ]
    return (MAP, *keys), tuple(every)


def variants(
    typed: Iterable[str], configure: Callable[[Sequence[str]], Config]
) -> tuple[tuple[str, ...], tuple[Variant, ...]]:
    """The parameters named by texts KEY=V1,V2[,...], and every combination of their values.

    ``configure``: the configuration that ``key=value`` texts lead to. Commas within brackets part no values. Raises
    MclError for a text of another form, an unknown parameter, and where two values come to the same.
    """
    keys, choices = [], []
    for text in typed:
        key, sep, values = text.partition("=")
        parts = [part.strip() for part in re.split(r",(?![^\[]*\])", values)]
        if sep and key.strip():
            check_name(key.strip())
        if not sep or not key.strip() or len(parts) < 2 or not all(parts):
            raise MclError(f"--vary {text!r}: expected KEY=V1,V2, with two values or more")
        keys.append(ALIASES.get(key.strip(), key.strip()))
        choices.append(parts)
    found = tuple(
        Variant(values, configure([f"{key}={value}" for key, value in zip(keys, values, strict=True)]))
        for values in itertools.product(*choices)
    )
    for one, other in itertools.combinations(found, 2):
        if one.config == other.config:
            hint = "an option of its own, like --particles, wins over --vary"
            raise MclError(f"--vary: {one.label!r} and {other.label!r} come to the same configuration", hint)
    return tuple(keys), found
