"""mcl-replay: a laser-and-odometry log and a map go in, a recording of how the lost robot was found comes out.

What a program needs stands here: ``from pipeline import Config, load_map, localize, read_log``. Each is imported when
it is first asked for: a compiler is behind them, and whoever asks for --help must not wait for that.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

# By name, so that the layers below, which ask for the version, do not import those above.
_HOMES = {
    "Config": ("pipeline.config", "Config"),
    "MclError": ("pipeline.errors", "MclError"),
    "RunResult": ("pipeline.localization", "RunResult"),
    "load_config": ("pipeline.config", "load_config"),
    "load_map": ("converters", "read_map"),
    "localize": ("pipeline.localization", "localize"),
    "read_log": ("pipeline.logs.reader", "read_log"),
    "write_tum": ("pipeline.logs.tum", "write_tum"),
}

__all__ = [*_HOMES]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, own_name = _HOMES[name]
    value = globals()[name] = getattr(import_module(module), own_name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
