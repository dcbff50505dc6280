"""What is wrong with a command as it was typed, told in one line as bad input is."""

from __future__ import annotations

from typing import Any

import typer

from pipeline.spelling import did_you_mean

# Where typer keeps this one has changed; what it is derived from has not.
UsageError: Any = typer.BadParameter.__bases__[0]


def told_in_one_line(error: Any) -> str | None:
    """The command, what is wrong, and where help is; None if nothing was typed and the help itself is shown."""
    if type(error).__name__ == "NoArgsIsHelpError":
        return None
    command = error.ctx.command_path if error.ctx is not None else "mcl"
    said, near = _told(error)
    return f"{command}: {said} ({near or f'{command} --help tells more'})"


def _told(error: Any) -> tuple[str, str]:
    """What is wrong, and what may have been meant."""
    known: Any = error.ctx.command if error.ctx is not None else None
    message = str(error.message).rstrip(".")
    if message.startswith("No such command"):
        name = message.split("'")[1]
        return f"there is no command {name!r}", did_you_mean(name, known.commands if known is not None else ())
    if getattr(error, "possibilities", None) is not None or message.startswith("No such option"):
        options = [name for parameter in known.params for name in parameter.opts] if known is not None else []
        return f"there is no option {error.option_name}", did_you_mean(error.option_name, options)
    if type(error).__name__ == "MissingParameter":
        return f"{_name(error.param)} is missing", ""
    if isinstance(error, typer.BadParameter):
        where = f"{_name(error.param)}: " if error.param is not None else ""
        return f"{where}{_value(error, message)}", ""
    return message[:1].lower() + message[1:], ""


def _name(parameter: Any) -> str:
    """An option as it is typed, an argument as the help calls it."""
    if parameter is None:
        return "an argument"
    return parameter.opts[0] if parameter.param_type_name == "option" else parameter.metavar or parameter.name.upper()


def _value(error: Any, message: str) -> str:
    """What a value should have been."""
    from pydantic import ValidationError

    from pipeline.wrong_values import expectation

    if not isinstance(error.__cause__, ValidationError):
        return message
    first = error.__cause__.errors()[0]
    if first["type"] == "value_error":  # it names the value itself: 'blue' is not one of 'print', 'dark'
        return expectation(first).rstrip(".")
    return f"{expectation(first)}, got {first['input']}"
