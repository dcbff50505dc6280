"""mcl-replay: a laser-and-odometry log and a map go in, a recording of how the lost robot was found comes out.

What a program needs stands here: ``import pipeline as mcl``, and then ``mcl.read_log``, ``mcl.localize`` and so on;
docs/api.md lists all of it. Each name is imported when it is first asked for: a compiler is behind some of them, and
whoever asks for --help must not wait for that.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

# By name, so that the layers below, which ask for the version, do not import those above.
_HOMES = {
    "Beams": ("pipeline.filter.step", "Beams"),
    "Comparison": ("pipeline.evaluate", "Comparison"),
    "Config": ("pipeline.config", "Config"),
    "Estimate": ("pipeline.filter.step", "Estimate"),
    "Evaluation": ("pipeline.evaluate", "Evaluation"),
    "Event": ("pipeline.filter.step", "Event"),
    "Laser": ("pipeline.logs.messages", "Laser"),
    "Localizer": ("pipeline.localization", "Localizer"),
    "Log": ("pipeline.logs.messages", "Log"),
    "LogEvaluation": ("pipeline.evaluate", "LogEvaluation"),
    "MclError": ("pipeline.errors", "MclError"),
    "Names": ("pipeline.logs.recorded", "Names"),
    "OccupancyGrid": ("pipeline.maps.occupancy_grid", "OccupancyGrid"),
    "Replay": ("pipeline.replay", "Replay"),
    "Run": ("pipeline.export.run", "Run"),
    "RunComparison": ("pipeline.compare", "Comparison"),
    "RunResult": ("pipeline.localization", "RunResult"),
    "Scan": ("pipeline.logs.messages", "Scan"),
    "Score": ("pipeline.evaluate.metrics", "Score"),
    "Sink": ("pipeline.localization", "Sink"),
    "Step": ("pipeline.filter.step", "Step"),
    "Track": ("pipeline.compare", "Track"),
    "Trajectory": ("pipeline.logs.messages", "Trajectory"),
    "Verdict": ("pipeline.judgement.verdict", "Verdict"),
    "Wishes": ("pipeline.export.files", "Wishes"),
    "compare_configs": ("pipeline.evaluate.programs", "compare_configs"),
    "compare_runs": ("pipeline.compare", "compare"),
    "draw_belief": ("pipeline.drawing", "draw_belief"),
    "draw_map": ("pipeline.drawing", "draw_map"),
    "draw_run": ("pipeline.drawing", "draw_run"),
    "dump_config": ("pipeline.config", "dump_config"),
    "evaluate_logs": ("pipeline.evaluate.programs", "evaluate_logs"),
    "export_run": ("pipeline.export.files", "export"),
    "load_config": ("pipeline.config", "load_config"),
    "load_map": ("converters", "read_map"),
    "localize": ("pipeline.localization", "localize"),
    "plot_evaluation": ("pipeline.evaluate", "plot"),
    "read_log": ("converters.cached", "read_log"),
    "read_run": ("pipeline.export.run", "read_run"),
    "read_tum": ("pipeline.logs.tum", "read_tum"),
    "record_run": ("pipeline.replay", "record_run"),
    "run_errors": ("pipeline.evaluate.judged", "run_errors"),
    "sample_log": ("pipeline.simulate.sample", "sample_log"),
    "score_run": ("pipeline.evaluate.judged", "score_run"),
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
