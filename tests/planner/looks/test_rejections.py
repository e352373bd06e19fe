"""The reasons against chains, the commonest first."""

from __future__ import annotations

from microplan.featuresel.trials.score import ChainScore
from microplan.planner.looks.records import commonest_hint, rejections

FEW = "rejected: success {}% of 24 trials, at least 98% ({})"
WIDE = "rejected: 2 sigma + |bias| is {} um, tolerance 1 um"


def test_the_commonest_reason_comes_first_and_once() -> None:
    said = rejections([
        (("ncc",), WIDE.format(3.1)),
        (("otsu",), FEW.format(50, "12 no_contrast")),
        (("otsu", "tooth_notch"), FEW.format(0, "24 no_contrast")),
        (("otsu", "ecc"), FEW.format(0, "20 no_contrast, 4 outside")),
        (("likelihood",), "rejected: gives no angle, which is needed"),
    ])  # fmt: skip
    assert said == (
        "otsu and 1 more: success 50% of 24 trials, at least 98% (12 no_contrast); "
        "ncc: 2 sigma + |bias| is 3.1 um, tolerance 1 um; "
        "otsu > ecc: success 0% of 24 trials, at least 98% (20 no_contrast, 4 "
        "outside); "
        "likelihood: gives no angle, which is needed"
    )
    assert rejections([]) == ""


def score(success: int, *failures: tuple[str, int]) -> ChainScore:
    """Return a score of which the counts matter."""
    return ChainScore(
        chain=("ncc",), trials=success + sum(count for _, count in failures),
        success=success, success_lower=0.0, silent=0, silent_upper=1.0,
        failures=failures, bias_um=(0.0, 0.0), sigma_um=None, worst_um=None, angles=0,
        bias_theta_rad=None, sigma_theta_rad=None, cost=1.0,
    )  # fmt: skip


def test_the_hint_goes_by_what_most_trials_fail_by() -> None:
    dark = [score(2, ("no_contrast", 20), ("outside", 2)), score(0, ("no_edge", 24))]
    said = commonest_hint(dark, "take ncc")
    assert said.startswith("take ncc; most trials fail for want of contrast: ")
    far = [score(0, ("no_contrast", 8), ("outside", 16))]
    assert commonest_hint(far, "").startswith(
        "most trials fail as it lies too far off: "
    )
    assert commonest_hint([score(24)], "a wider tolerance") == "a wider tolerance"
    assert commonest_hint([], "none") == "none"
