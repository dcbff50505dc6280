"""Columns as a pandas table, for those who have pandas: it is imported only when somebody asks for one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pipeline.errors import MclError

if TYPE_CHECKING:
    import pandas as pd


def data_frame(columns: Mapping[str, Any]) -> pd.DataFrame:
    """A table of columns of equal length, which it copies. Raises MclError if pandas is not installed."""
    try:
        import pandas as pd
    except ImportError as error:
        raise MclError("pandas is not installed", "pip install 'mcl-replay[pandas]'") from error
    return pd.DataFrame(dict(columns), copy=True)
