"""The effects ledger: what is modelled, how, and what leaving the rest out costs."""

from __future__ import annotations

from collections.abc import Sequence

from microplan.planner.store.summary import EFFECTS
from microplan.schemas.page.elements import Element, Node, el
from microplan.schemas.page.figures import number
from microplan.schemas.page.page import Column, more, table
from microplan.schemas.plan import EffectRow

_COLUMNS = (
    Column("effect"), Column("how it is treated"), Column("error left", numeric=True),
    Column("limit", numeric=True), Column("reason"),
)  # fmt: skip


def ledger(rows: Sequence[EffectRow], of: str) -> Element | None:
    """Return the effects of a look or step, what is beyond its limit told first."""
    if not rows:
        return None
    over = sum(_is_over(row) for row in rows)
    silent = sum(row.predicted_error is None for row in rows)
    told = f"{over} above their limit, " if over else ""
    title = f"Effects of {of}: {len(rows)}, {told}{silent} without a number"
    return more(title, table(_COLUMNS, [_cells(row) for row in rows]))


def _is_over(row: EffectRow) -> bool:
    error, limit = row.predicted_error, row.limit
    return error is not None and limit is not None and error > limit


def _cells(row: EffectRow) -> list[Node]:
    """Return the cells of one effect."""
    said = number(row.predicted_error, 2)
    unit = f" {row.unit}" if row.predicted_error is not None else ""
    over = _is_over(row)
    error = el("span", f"{said}{unit}", " \u2013 above the limit" if over else None,
               class_="bad" if over else None)  # fmt: skip
    return [
        EFFECTS.get(row.effect, row.effect),
        row.level,
        error,
        "\u2013" if row.limit is None else f"{number(row.limit, 2)} {row.unit}",
        row.reason,
    ]
