# What pipeline/__init__.py loads lazily, for those who only read it: type checkers and editors.
from converters import read_map as load_map
from converters.cached import read_log
from pipeline.compare import Comparison as RunComparison
from pipeline.compare import Track
from pipeline.compare import compare as compare_runs
from pipeline.config import Config, dump_config, load_config
from pipeline.drawing import draw_belief, draw_map, draw_run
from pipeline.errors import MclError
from pipeline.evaluate import Comparison, Evaluation, LogEvaluation
from pipeline.evaluate import plot as plot_evaluation
from pipeline.evaluate.judged import run_errors, score_run
from pipeline.evaluate.metrics import Score
from pipeline.evaluate.programs import compare_configs, evaluate_logs
from pipeline.export.files import Wishes
from pipeline.export.files import export as export_run
from pipeline.export.run import Run, read_run
from pipeline.filter.step import Beams, Estimate, Event, Step
from pipeline.judgement.verdict import Verdict
from pipeline.localization import Localizer, RunResult, Sink, localize
from pipeline.logs.messages import Laser, Log, Scan, Trajectory
from pipeline.logs.recorded import Names
from pipeline.logs.tum import read_tum, write_tum
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.replay import Replay, record_run
from pipeline.simulate.sample import sample_log

__all__ = [
    "Beams",
    "Comparison",
    "Config",
    "Estimate",
    "Evaluation",
    "Event",
    "Laser",
    "Localizer",
    "Log",
    "LogEvaluation",
    "MclError",
    "Names",
    "OccupancyGrid",
    "Replay",
    "Run",
    "RunComparison",
    "RunResult",
    "Scan",
    "Score",
    "Sink",
    "Step",
    "Track",
    "Trajectory",
    "Verdict",
    "Wishes",
    "compare_configs",
    "compare_runs",
    "draw_belief",
    "draw_map",
    "draw_run",
    "dump_config",
    "evaluate_logs",
    "export_run",
    "load_config",
    "load_map",
    "localize",
    "plot_evaluation",
    "read_log",
    "read_run",
    "read_tum",
    "record_run",
    "run_errors",
    "sample_log",
    "score_run",
    "write_tum",
]

__version__: str
