"""Recordings made at once, into a file or into a viewer that is open already."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from pipeline.errors import MclError
from pipeline.recording.viewer import check_address


@contextmanager
def opened(sink: Any, application_id: str, recording_id: str, layout: rrb.Blueprint) -> Iterator[rr.RecordingStream]:
    """A recording to be filled: the layout goes ahead of it, and at the end all of it has arrived."""
    rr.set_strict_mode(True)
    stream = rr.RecordingStream(application_id, recording_id=recording_id)
    stream.set_log_time_enabled(False)
    stream.set_sinks(sink, default_blueprint=layout)
    try:
        yield stream
        stream.flush()
    finally:
        stream.disconnect()


def sending(address: str, fill: Callable[[Any], None]) -> None:
    """Fills what goes to the viewer at ``address``. Raises MclError if it takes nothing."""
    rr.set_strict_mode(True)
    check_address(address)
    try:
        fill(rr.GrpcSink(address))
    except RuntimeError as error:
        raise MclError(f"the viewer at {address} does not take it: {error}") from error
