"""The table of a sweep: lines of text as rows come, and a CSV file of all."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields

from microplan.planner.sweep.rows import SweepRow
from microplan.planner.sweep.variants import Setting, Variant, written

_MOST_WIDE = 40  # characters of a value or a reason on the terminal


class SweepLines:
    """Lines of text whose columns are known before the rows are."""

    def __init__(self, settings: Sequence[Setting], count: int) -> None:
        texts = [[s.key, *map(_cell, s.values)] for s in settings]
        self._widths = [
            max(len(str(count)), 3),
            *(max(map(len, column)) for column in texts),
        ]
        self._keys = [s.key for s in settings]

    @property
    def head(self) -> str:
        """Return the names of the columns."""
        last = ("P", "P at least", "worst um", "s", "status")
        return self._line(["row", *self._keys], last)

    def line(self, variant: Variant, row: SweepRow) -> str:
        """Return the line of a row."""
        numbers = (
            _number(row.success_probability, ".4f"),
            _number(row.success_lower, ".4f"),
            _number(row.worst_sigma_um, ".3f"),
            _number(row.time_s, ".1f"),
        )
        reason = f": {_short(row.reason, 2 * _MOST_WIDE)}" if row.reason else ""
        values = [_cell(variant.values[key]) for key in self._keys]
        return self._line([f"{variant.row}", *values], (*numbers, row.status + reason))

    def _line(self, left: Sequence[str], right: Sequence[str]) -> str:
        cells = [text.rjust(w) for text, w in zip(left, self._widths, strict=True)]
        *numbers, last = right
        cells += [text.rjust(w) for text, w in zip(numbers, (6, 10, 8, 7), strict=True)]
        return "  ".join([*cells, last])


def is_table(begin: str) -> bool:
    """Return whether a file that begins with a text may be a table of a sweep."""
    try:
        head = next(csv.reader(io.StringIO(begin)), None)
    except csv.Error:
        return False
    return head is None or [*head[:1], *head[-1:]] == ["row", "other_cpu"]


def csv_text(found: Mapping[int, tuple[Variant, SweepRow]], own_cpu: str) -> str:
    """Return all rows in their order; `other_cpu`: made by another than `own_cpu`."""
    stream = io.StringIO()
    names = [field.name for field in fields(SweepRow)]
    keys = next((list(v.values) for v, _ in found.values()), [])
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["row", *keys, *names, "other_cpu"])
    for number in sorted(found):
        variant, row = found[number]
        values = [written(value) for value in variant.values.values()]
        cells = ["" if each is None else each for each in asdict(row).values()]
        other = "yes" if row.cpu != own_cpu else "no"
        writer.writerow([number, *values, *cells, other])
    return stream.getvalue()


def _cell(value: object) -> str:
    return _short(written(value), _MOST_WIDE)


def _short(text: str, most: int) -> str:
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[: most - 3]}..."


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)
