# What pipeline/__init__.py loads lazily, for those who only read it: type checkers and editors.
from converters import read_map
from pipeline.config import Config, load_config
from pipeline.errors import MclError
from pipeline.localization import RunResult, localize
from pipeline.logs.reader import read_log
from pipeline.logs.tum import write_tum

__all__ = ["Config", "MclError", "RunResult", "load_config", "load_map", "localize", "read_log", "write_tum"]

__version__: str
load_map = read_map
