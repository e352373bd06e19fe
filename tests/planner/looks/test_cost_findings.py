"""Words on chains that errors of images spoil."""

from __future__ import annotations

import pytest

from microplan.planner.looks.cost_findings import struck_words
from microplan.planner.looks.model_errors.charged_chains import ChargedChains

OWN, SPARE, OUT = ("ncc",), ("otsu", "iso_circle"), ("otsu",)
NEAREST = "ncc is used, of these the nearest to its tolerance, without a fallback"
NEED = "2 sigma and the half-width are 2 um, tolerance 1 um"


@pytest.mark.parametrize(
    ("charges", "spare", "said"),
    [
        (ChargedChains(), SPARE, ""),
        (ChargedChains(), None, ""),
        (
            ChargedChains(struck={OUT: NEED}), SPARE,
            f"errors of images spoil otsu: {NEED}; ncc is used, then otsu > iso_circle",
        ),
        (
            ChargedChains(struck={OUT: NEED}, missed=NEED), None,
            f"errors of images spoil otsu: {NEED}; ncc: {NEED}; {NEAREST}",
        ),
    ],
)  # fmt: skip
def test_all_that_is_spoilt_is_said_with_what_is_used(
    charges: ChargedChains, spare: tuple[str, ...] | None, said: str
) -> None:
    assert struck_words(charges, OWN, spare) == said
