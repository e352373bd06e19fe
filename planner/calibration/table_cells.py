"""Cells of a table's line, and numbers in them."""

from __future__ import annotations

import csv
import io


def cells_of(line: str) -> list[str] | str:
    """Return the cells of a line, or why there are none."""
    try:
        return [cell.strip() for cell in next(csv.reader(io.StringIO(line)), [])]
    except csv.Error as error:
        return f"the line is no row of a table: {error}"


def number_of(text: str) -> float:
    """Return a number of digits, ValueError if it is none as tables have them."""
    if not text.isascii() or "_" in text:
        raise ValueError(f"no number: {text!r}")
    return float(text)
