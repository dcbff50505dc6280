"""Named configurations, a YAML file each; what such a file warns of."""

from __future__ import annotations

from pathlib import Path

_MARK = "# warning:"


def warning(name: str | None) -> str:
    """What the preset of this name warns of, in comments that begin with "warning:"; mostly empty."""
    path = Path(__file__).parent / f"{name}.yaml"
    if not path.is_file():
        return ""
    lines = path.read_text(encoding="utf-8").splitlines()
    return " ".join(line.removeprefix(_MARK).strip() for line in lines if line.startswith(_MARK))
