"""A part of a user's own at work: called with what it asks for, and watched."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.parts.loading import Part, line_of, told

FARTHEST = 1e6
"""m: no pose and no step is farther."""


class Own:
    """A part with its parameters, ready to be called.

    ``values``: its own parameters, all of them. ``offered``: what the program has for it, by name; an object of a class
    is made with what its constructor names of it. Raises MclError, with file and line, where the part fails.
    """

    def __init__(self, part: Part, values: Mapping[str, Any], **offered: Any) -> None:
        self._part, self._offered = part, offered
        self._path, _ = part.place
        self.method = part.method
        call: Callable[..., Any] = part.target
        self._values: Mapping[str, Any] = values
        self.made: Any = None
        if part.is_class:
            asked = part.arguments(part.target)
            given = {key: offered[key] for key in asked if key in offered} | dict(values)
            self.made = self._watched(lambda: part.target(**given))
            call, self._values = getattr(self.made, part.method.name), {}
        self._call = call
        self._asks = [key for key in part.arguments(call) if key not in self._values]

    def __call__(self, *leads: Any, **offered: Any) -> Any:
        """What the part answers to its leading arguments; ``offered``: more by name, of which it gets what it names."""
        have = self._offered | offered
        given = {key: have[key] for key in self._asks[len(leads) :] if key in have}
        return self._watched(lambda: self._call(*leads, **given, **self._values))

    def asks_for(self, name: str) -> bool:
        """Whether the part names this argument."""
        return name in self._asks

    def other(self, name: str) -> Callable[..., Any] | None:
        """Another method of the object, if it is one and has it."""
        method = getattr(self.made, name, None)
        return None if method is None else lambda *leads: self._watched(lambda: method(*leads))

    def array(self, answer: Any, shape: tuple[int, ...], what: str) -> NDArray[np.float64]:
        """The answer as float64, if it has this shape and is finite all over. Raises MclError if not."""
        if answer is None:
            raise self.wrong(f"it returned nothing, expected {what}, {shape}")
        try:
            array = np.asarray(answer, np.float64)
        except (TypeError, ValueError) as error:
            raise self.wrong(f"it gave {type(answer).__name__}, expected {what}, an array of {shape}") from error
        if array.shape != shape:
            raise self.wrong(f"it gave an array of {array.shape}, expected {what}, {shape}")
        if not np.isfinite(array).all():
            raise self.wrong(f"it gave {what} that are not finite")
        return array

    def poses(self, answer: Any, shape: tuple[int, ...], what: str = "poses") -> NDArray[np.float64]:
        """The same of poses or steps, which are no farther than any robot is. Raises MclError if not."""
        array = self.array(answer, shape, what)
        if array.size and np.abs(array).max() > FARTHEST:
            raise self.wrong(f"it gave {what} as large as {np.abs(array).max():.3g}, expected metres and radians")
        return array

    def pair(self, answer: Any, what: str) -> tuple[Any, Any]:
        """The two things that the answer consists of. Raises MclError if they are not two."""
        if isinstance(answer, tuple | list) and len(answer) == 2:
            return answer[0], answer[1]
        raise self.wrong(f"it gave {'nothing' if answer is None else type(answer).__name__}, expected {what}")

    def covariance(self, answer: Any) -> NDArray[np.float64]:
        """A covariance (3, 3) of a pose. Raises MclError if it is none."""
        matrix = self.array(answer, (3, 3), "a covariance")
        if np.abs(matrix).max() > FARTHEST**2:
            raise self.wrong(f"it gave a covariance as large as {np.abs(matrix).max():.3g}")
        if not np.allclose(matrix, matrix.T) or np.linalg.eigvalsh(matrix)[0] < -1e-9 * max(np.abs(matrix).max(), 1e-9):
            raise self.wrong("it gave a covariance that is not symmetric, or negative in some direction")
        return (matrix + matrix.T) / 2.0

    def wrong(self, said: str) -> MclError:
        """An error that names the part, its file and its first line."""
        path, line = self._part.place
        return MclError(f"{self._part.role.name} {self._part.short}: {said}", path=path, line=line)

    def _watched(self, call: Callable[[], Any]) -> Any:
        try:
            return call()
        except MclError:
            raise
        except Exception as error:
            said = f"{self._part.role.name} {self._part.short}: {told(error)}"
            scalar = isinstance(error, TypeError) and ("0-dimensional" in str(error) or "length-1" in str(error))
            hint = "it is given arrays: use np.exp and its like, not math.exp" if scalar else ""
            raise MclError(said, hint, path=self._path, line=line_of(error, self._path)) from error
