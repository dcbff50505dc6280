"""How much a command says: --quiet and -v, which every command has and which mean the same in each."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable
from functools import wraps
from typing import Annotated, Any, get_type_hints

import typer

from pipeline import console
from pipeline.printable import seconds


def _sets(volume: int) -> Callable[[bool], bool]:
    def callback(wanted: bool) -> bool:
        if wanted:
            console.set_volume(volume)
        return wanted

    return callback


_OPTIONS: dict[str, Any] = {
    "quiet": Annotated[
        bool,
        typer.Option(
            "--quiet",
            "-q",
            is_eager=True,
            callback=_sets(console.QUIET),
            help="Say nothing on stderr but errors; stdout stays as it is.",
        ),
    ],
    "verbose": Annotated[
        bool,
        typer.Option(
            "--verbose",
            "-v",
            is_eager=True,
            callback=_sets(console.VERBOSE),
            help="Also say what is read and decided, and how long it takes.",
        ),
    ],
}


def with_volume(command: Callable[..., None]) -> Callable[..., None]:
    """The command with both options, which are heard before any other is looked at."""
    hints = get_type_hints(command, include_extras=True)
    given = [each.replace(annotation=hints[each.name]) for each in inspect.signature(command).parameters.values()]
    own = [
        inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD, default=False, annotation=option)
        for name, option in _OPTIONS.items()
    ]

    @wraps(command)
    def heard(*, quiet: bool, verbose: bool, **values: Any) -> None:
        if quiet and verbose:
            raise typer.BadParameter("--quiet says less and --verbose more: give one of them")
        began = time.perf_counter()
        command(**values)
        console.detail(f"done in {seconds(time.perf_counter() - began)}")

    parameters = [*given, *own]
    heard.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    heard.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return heard
