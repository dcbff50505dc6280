"""The command line `mcl`: parse, call, print. What it loads to show --help is light; the rest waits for a command."""

from __future__ import annotations

import atexit
import gc
import signal
import sys
import threading
from types import FrameType
from typing import Annotated, Any

if _loading := threading.current_thread() is threading.main_thread():
    # Whoever thinks better of it while this loads sees no traceback.
    _interrupt = signal.signal(signal.SIGINT, signal.SIG_DFL)

import typer
from typer.core import TyperGroup

from pipeline import __version__, console
from pipeline.cli.benching import bench
from pipeline.cli.checking import check
from pipeline.cli.comparing import compare, view
from pipeline.cli.evaluation import evaluate
from pipeline.cli.exporting import export
from pipeline.cli.lessons import lesson
from pipeline.cli.logs import convert, simulate
from pipeline.cli.parameters import config
from pipeline.cli.reckoning import odometry
from pipeline.cli.runs import demo, inspect, localize
from pipeline.cli.sharing import share
from pipeline.cli.tuning import tune
from pipeline.cli.usage import UsageError, told_in_one_line
from pipeline.cli.volume import with_volume
from pipeline.errors import MclError

BAD_INPUT, BAD_USAGE, INTERRUPTED, TERMINATED = 1, 2, 130, 128 + signal.SIGTERM


class _Commands(TyperGroup):
    """Ends every command the same way: what a user can mend is one line and an exit code, never a traceback."""

    def make_context(self, *args: Any, **extra: Any) -> Any:
        console.set_volume(console.NORMAL)
        try:
            return super().make_context(*args, **extra)
        except UsageError as error:
            raise _bad_usage(error) from error

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except UsageError as error:
            raise _bad_usage(error) from error
        except MclError as error:
            console.error(str(error))
        except BrokenPipeError:
            raise  # whoever read our output has seen enough: typer knows how to leave quietly
        except OSError as error:
            place = f"{error.filename}: " if error.filename else ""
            console.error(f"{place}{error.strerror or error}")
        except MemoryError as error:
            console.error(f"not enough memory: {str(error) or 'fewer particles may do'}")
        except KeyboardInterrupt:
            console.error("interrupted")
            raise typer.Exit(INTERRUPTED) from None
        except SystemExit as end:
            if end.code == TERMINATED:
                console.error("terminated")
            raise
        raise typer.Exit(BAD_INPUT)

    def list_commands(self, _: Any) -> list[str]:
        return list(self.commands)  # in the order in which a newcomer meets them


app = typer.Typer(
    cls=_Commands,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command in (
    demo,
    convert,
    check,
    localize,
    inspect,
    view,
    compare,
    evaluate,
    tune,
    odometry,
    simulate,
    export,
    share,
    config,
    lesson,
    bench,
):
    app.command()(with_volume(command))


def _bad_usage(error: UsageError) -> Exception:
    """The way out when what was typed cannot be understood; to have typed nothing at all shows the help."""
    if (said := told_in_one_line(error)) is None:
        return error
    console.error(said)
    return typer.Exit(BAD_USAGE)


def _show_version(wanted: bool) -> None:
    if wanted:
        console.result(f"mcl-replay {__version__}")
        raise typer.Exit


@app.callback()
def _about(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """A laser-and-odometry log and a map go in; a recording comes out that shows how the lost robot was found."""


if _loading:
    signal.signal(signal.SIGINT, _interrupt)


def main() -> None:
    """Run `mcl`. Exit codes: 0, 1 bad input, 2 bad usage, 3 a requested limit failed, 130 Ctrl-C, 143 SIGTERM."""
    signal.signal(signal.SIGTERM, _terminate)
    # Loading libraries makes a million objects and no rubbish: to look for it every 700 objects, as Python does, takes
    # a tenth of a short run, and to look once more at the end, when all goes anyway, another 0.15 s.
    gc.set_threshold(100_000, 20, 50)
    atexit.register(gc.freeze)
    try:
        app(prog_name="mcl")
    except KeyboardInterrupt:  # before a command was begun, or after it had ended
        console.error("interrupted")
        sys.exit(INTERRUPTED)
    finally:  # All is done: an exception while Python ends would be a fatal error, in which it dumps its core.
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)


def _terminate(number: int, _: FrameType | None) -> None:
    # As an exception, so that recordings are closed and temporary files removed on the way out.
    sys.exit(128 + number)
