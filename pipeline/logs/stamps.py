"""Stamps are integer nanoseconds end to end: from decimal text and back without passing through a float."""

from __future__ import annotations

from decimal import Decimal

NANOSECONDS = 1_000_000_000
MOST = Decimal("1e18")
"""Seconds: the universe is not that old, and numbers without end would take time without end."""


def parse_stamp(text: str) -> int:
    """Nanoseconds of a decimal number of seconds; digits beyond the ninth are rounded.

    Raises ValueError if the text is no finite decimal number.
    """
    seconds, _, fraction = text.partition(".")
    if seconds.isdecimal() and len(fraction) <= 9 and (not fraction or fraction.isdecimal()):
        return int(seconds) * NANOSECONDS + int(fraction.ljust(9, "0"))
    try:
        if abs(number := Decimal(text)) < MOST:
            return round(number * NANOSECONDS)
        raise ValueError("too large")
    except (ArithmeticError, ValueError) as error:
        raise ValueError(f"{text!r} is not a number of seconds") from error


def format_stamp(stamp: int, decimals: int = 9) -> str:
    """Seconds with nine decimals, or with fewer where the stamp needs no more than those."""
    sign, (seconds, fraction) = "-" if stamp < 0 else "", divmod(abs(stamp), NANOSECONDS)
    digits = f"{fraction:09d}"
    return f"{sign}{seconds}.{digits[:decimals] if not int(digits[decimals:] or 0) else digits}"
