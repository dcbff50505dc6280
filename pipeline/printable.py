"""Text from files and from other people's recordings, made safe for a terminal and a page."""

from __future__ import annotations

import unicodedata

_KEPT = "\n\t"
_HARMFUL = frozenset({"Cc", "Cf", "Cs", "Co", "Zl", "Zp"})
"""Categories of Unicode: control, format (that turn the direction of writing round, too), halves of pairs, private use,
and separators of lines."""


def printable(text: str) -> str:
    """The text with whatever a terminal might obey written out: an escape becomes the four characters ``\\x1b``.

    Line ends and tabs stay, for our own sentences have them.
    """
    if text.isprintable() or all(c in _KEPT or c.isprintable() for c in text):
        return text
    return "".join(_shown(character) for character in text)


def one_line(text: str) -> str:
    """The same of a name or a number within a line: ends of lines and tabs are written out, too."""
    return printable(text) if text.isprintable() else printable(text.replace("\n", "\\n").replace("\t", "\\t"))


def _shown(character: str) -> str:
    if character in _KEPT or unicodedata.category(character) not in _HARMFUL:
        return character
    code = ord(character)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def seconds(span: float) -> str:
    """How long something took or takes: ``0.07 s``, ``93.4 s``, ``12.5 min``, ``2.4 h``."""
    if span < 1.0:
        return f"{span:.2f} s"
    if span < 600.0:
        return f"{span:.1f} s"
    return f"{span / 60.0:.1f} min" if span < 7200.0 else f"{span / 3600.0:.1f} h"
