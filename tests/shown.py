"""The files that a page of the docs shows, as a reader would write them."""

from __future__ import annotations

import re
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"


def write_shown(page: str, folder: Path) -> Path:
    """Every block of Python that begins with the name of its file, written into the folder."""
    for name, text in re.findall(r"```python\n# (\w+\.py)\n(.*?)```", (DOCS / page).read_text(), flags=re.DOTALL):
        assert len(text.splitlines()) < 30
        (folder / name).write_text(text)
    return folder
