"""What is known of a look saves work and changes no outcome."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from microplan.featuresel.look.design import design
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.trial_cache import Known, Looks
from microplan.featuresel.trials.trials import prepare, run

Look = Callable[[str], LookCase]

CHAINS: tuple[Chain, ...] = (("otsu",), ("otsu", "circle_caliper"))


def test_what_is_known_changes_no_outcome_and_is_not_found_again(look: Look) -> None:
    case = look("post")
    ready, trials = prepare(case, CHAINS), design(case, 4, 1)
    plain, known, asked = run(case, ready, trials), Known(), []

    def noted(function: Callable[[object], object], items: Iterable[object]) -> object:
        asked.append(len(list(items)))
        return map(function, items)

    run(case, replace(ready, chains=CHAINS[:1]), trials[:3], known=known)
    assert set(known.pictures) == {0, 1, 2}
    assert run(case, ready, trials, known=known) == plain
    assert run(case, ready, trials, map=noted, known=known) == plain  # type: ignore[arg-type]  # it only counts
    assert asked == [0]  # nothing was left to do


def test_another_tolerance_asks_about_the_same_look(look: Look) -> None:
    case, looks = look("post"), Looks()
    first = looks.of(case, 1)
    assert (
        looks.of(replace(case, tolerance_um=9.0, tolerance_theta_rad=0.1), 1) is first
    )
    assert looks.of(case, 2) is not first
    second = looks.of(case, 2)
    assert looks.of(replace(case, focus_um=case.focus_um + 1), 2) is not second


def test_pictures_are_kept_while_there_is_room() -> None:
    known, large = Known(), np.zeros(3 << 24, dtype=np.uint8)
    known.keep(0, large)
    known.keep(1, large)
    known.keep(2, None)
    assert set(known.pictures) == {0}
