"""The layout that travels ahead of a recording, and is corrected once the run is over: how high its curves reach.

A second layout would add a tenth to a recording, corrections of the first add next to nothing. But rerun's public
functions send whole layouts only, so this calls those that they call; rerun-sdk is pinned to one version.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
import rerun_bindings

AXIS = "ScalarAxis"  # as rerun names what belongs to a view


class SentLayout:
    """A layout on its way into the file, and into the viewer, of a recording."""

    def __init__(self, layout: rrb.Blueprint, stream: rr.RecordingStream, application_id: str) -> None:
        self._layout, self._stream, self._sequence = layout, stream, 0
        self._own = rr.RecordingStream._from_native(
            rerun_bindings.new_blueprint(
                application_id=application_id, make_default=False, make_thread_default=False, default_enabled=True
            )
        )
        self._memory = self._own.memory_recording()
        self._begin()
        layout._log_to_stream(self._own)
        self._send()

    def rescale(self, wanted: rrb.Blueprint) -> None:
        """Takes over the axes of values of a layout that is otherwise the same."""
        self._begin()
        for mine, other in zip(_views(self._layout.root_container), _views(wanted.root_container), strict=True):
            if (axis := other.properties.get(AXIS)) is not None:
                self._own.log(f"{mine.blueprint_path()}/{AXIS}", axis)
        self._send()

    def _begin(self) -> None:
        self._own.set_time("blueprint", sequence=self._sequence)
        self._sequence += 1

    def _send(self) -> None:
        # The default of whoever opens the file; what somebody has changed in a viewer stays.
        rerun_bindings.send_blueprint(
            self._memory.storage, make_active=False, make_default=True, recording=self._stream.to_native()
        )


def _views(part: Any) -> Iterator[rrb.View]:
    if isinstance(part, rrb.View):
        yield part
    else:
        for inner in part.contents:
            yield from _views(inner)
