"""What is wrong with a YAML file, in one line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import MclError


@contextmanager
def yaml_told(path: Path | str | None) -> Iterator[None]:
    """Whatever the parser says of the file within becomes an MclError with file and line."""
    from ruamel.yaml.error import YAMLError

    try:
        yield
    except MclError:
        raise
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or "not YAML"
        raise MclError(str(problem), path=path, line=mark.line + 1 if mark else None) from error
    except Exception as error:  # numbers, dates and keys that Python cannot hold
        raise MclError(f"not YAML: {error}", path=path) from error
