"""Rows of a ledger that are above their limits, before and after they are charged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from microplan.planner.looks.cost_findings import cost_words
from microplan.planner.looks.model_errors.answer_shift import AnswerShift
from microplan.planner.looks.model_errors.better_models import WALLS, BetterModel
from microplan.planner.looks.model_errors.charged_chains import ChargedChains
from microplan.planner.looks.model_errors.effect_rows import (
    finish_row,
    open_effects,
    with_costs,
)
from microplan.planner.looks.model_errors.model_cost import (
    EffectDifference,
    model_cost,
)
from microplan.schemas.plan import EffectRow

LIMIT = 0.002


def row(effect: str, error: float | None, unit: str = "unit contrast") -> EffectRow:
    return EffectRow(
        effect=effect, level="not modelled", predicted_error=error, limit=LIMIT,
        unit=unit, reason="",
    )  # fmt: skip


def walls() -> EffectDifference:
    shift = AnswerShift(
        pairs=12, freedom=6, mean=np.array([0.03, 0.04]),
        half_width=np.array([0.2, 0.1]), interval=np.zeros(2),
        sigma=np.array([0.1, 0.3]),
    )  # fmt: skip
    model = BetterModel(effects=(WALLS,), by="solid bodies", ends=())
    return EffectDifference(model=model, place=shift, turn=None, image_error=0.11)


@pytest.mark.parametrize(
    ("found", "is_open"),
    [
        (row("a", LIMIT), False), (row("a", 0.0021), True), (row("a", None), True),
        (row("a", 9.0, "nm"), False), (row("partial coherence", 0.3), False),
        (replace(row("a", 0.3), limit=None), False), (finish_row(LIMIT), True),
    ],
)  # fmt: skip
def test_what_is_above_its_limit_or_unknown_is_open(
    found: EffectRow, is_open: bool
) -> None:
    """What is in nm is charged already; coherence has an interval of its own."""
    assert bool(open_effects([found])) == is_open


def test_a_row_without_a_number_gets_one_and_its_cost() -> None:
    charges = ChargedChains(rows={WALLS: walls()})
    before = (row(WALLS, None), row("defocus law", 0.001))
    paid, other = with_costs(before, charges)
    assert other == before[1]
    assert (paid.predicted_error, paid.level) == (0.11, "charged")
    assert paid.cost is not None
    assert (paid.cost.bias_um, paid.cost.pairs) == ((0.03, 0.04), 12)
    known = with_costs((row(WALLS, 0.5),), charges)[0]
    assert (known.predicted_error, known.level) == (0.5, "not modelled")


def test_words_have_the_bias_and_how_well_it_is_known() -> None:
    rows = with_costs((row(WALLS, None),), ChargedChains(rows={WALLS: walls()}))
    said = cost_words(rows, model_cost([walls()]))
    assert "a bias of 0.05 ± 0.22 um" in said  # hypotenuses of 3, 4, 5
    assert f"sigma 0.3 um, by 12 pairs of images: {WALLS} 0.05 ± 0.22" in said
    assert cost_words((), None) == ""
