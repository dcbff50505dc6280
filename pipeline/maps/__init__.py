"""Maps: the occupancy grid and what is pre-computed from it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.maps.map_server import load_map

__all__ = ["load_map"]


def __getattr__(name: str) -> Any:
    """Imports what reads images and YAML when it is asked for, not before."""
    if name == "load_map":
        from pipeline.maps.map_server import load_map

        return load_map
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
