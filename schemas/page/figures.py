"""Number formats for readers: three digits, with their unit."""

from __future__ import annotations

import math

NARROW = "\u202f"  # no-break space between a number and its unit
MINUS = "\u2212"
MICRO = "\u00b5"


def number(value: float | None, digits: int = 3) -> str:
    """Return a number with so many significant digits, an en dash for None."""
    if value is None:
        return "\u2013"
    if not math.isfinite(value):
        return "any" if value > 0 else "none"
    size = abs(value)
    if size and (size < 1e-3 or size >= 1e6):
        mantissa, _, power = f"{size:.{digits - 1}e}".partition("e")
        text = f"{_short(mantissa)}\u00d710{_raised(int(power))}"
    else:
        places = max(digits - 1 - math.floor(math.log10(size)), 0) if size else 0
        text = _short(f"{size:.{places}f}")
    return MINUS + text if value < 0 and text != "0" else text


def quantity(value: float | None, unit: str, digits: int = 3) -> str:
    """Return a number with its unit, an en dash for None."""
    if value is None:
        return "\u2013"
    return f"{number(value, digits)}{NARROW}{unit}"


def seconds(value: float | None) -> str:
    """Return a time given in s, to two digits or hundredths; short ones in ms."""
    if value is not None and 0 < abs(value) < 0.1:
        return quantity(value * 1000, "ms", 2)
    digits = 3 if value is not None and abs(value) >= 1 else 2
    return quantity(value, "s", digits)


def um(value: float | None, digits: int = 3) -> str:
    """Return a length given in um; small ones in nm."""
    if value is not None and 0 < abs(value) < 0.1:
        return quantity(value * 1000, "nm", min(digits, 2))
    return quantity(value, "\u00b5m", digits)


def degrees(value_rad: float | None) -> str:
    """Return an angle given in rad."""
    if value_rad is None:
        return "\u2013"
    return f"{number(math.degrees(value_rad))}\u00b0"


def span(low: float, high: float, unit: str) -> str:
    """Return an interval of errors, signs shown."""
    return f"{signed(low)} to {signed(high)}{NARROW}{unit}"


def signed(value: float) -> str:
    """Return a number with its sign."""
    text = number(value)
    return f"+{text}" if value > 0 else text


def chance(value: float | None) -> str:
    """Return a probability; what four digits would make 1 is never written as 1.

    A plan keeps six digits, so that its own 1 may mean a little less.
    """
    if value is None:
        return "\u2013"
    if value == 0:
        return "0"
    if value > 0.99995:
        return "> 0.9999"
    if value < 0.00005:
        return "< 0.0001"
    return f"{value:.4f}"


def _short(text: str) -> str:
    """Return a decimal number without zeros at its end."""
    return text.rstrip("0").rstrip(".") if "." in text else text


def _raised(power: int) -> str:
    digits = str.maketrans(
        "-0123456789",
        "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079",
    )
    return str(power).translate(digits)
