"""The search for the last drift that holds against one that tries every step."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.trials import tolerance_search as reach
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.tolerance_search import (
    FOCUS_UM,
    STRIDE,
    ZOOM,
    Direction,
    ToleranceSearch,
    last_held,
    usable_range,
)
from microplan.featuresel.trials.trials import prepare

Look = Callable[[str], LookCase]


def plain(count: int, holds: Callable[[int], bool]) -> int:
    """Return the last step before the first that fails, by trying all of them."""
    return next((k for k in range(count) if not holds(k)), count) - 1


@given(st.integers(1, 40), st.integers(0, 40))
def test_steps_that_never_hold_again_are_found_as_by_trying_all(
    count: int, first: int
) -> None:
    assert last_held(count, lambda k: k < first) == plain(count, lambda k: k < first)


@given(st.lists(st.booleans(), min_size=1, max_size=40))
def test_the_step_found_holds_the_next_does_not_and_long_gaps_end_it(
    held: list[bool],
) -> None:
    found = last_held(len(held), held.__getitem__)
    assert found < 0 or held[found]
    assert found + 1 == len(held) or not held[found + 1]
    gaps = [k for k in range(found) if not any(held[k : min(k + STRIDE, found)])]
    assert not [k for k in gaps if k + STRIDE <= found]


@pytest.mark.parametrize("steps", [FOCUS_UM, ZOOM])
def test_no_more_than_six_steps_are_tried(steps: tuple[float, ...]) -> None:
    for first in range(len(steps) + 1):
        asked: list[int] = []

        def holds(k: int, first: int = first, asked: list[int] = asked) -> bool:
            asked.append(k)
            return k < first

        last_held(len(steps), holds)
        assert len(asked) == len(set(asked)) <= 6


@pytest.mark.parametrize(
    ("name", "routine"), [("post", "circle_caliper"), ("between", "otsu")]
)
def test_ranges_of_looks_are_those_found_by_trying_all(
    name: str, routine: str, look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = look(name)
    ready = prepare(case, [(routine,)])
    quick = usable_range(case, ready, (routine,), root_seed=3, draws=1)
    monkeypatch.setattr(reach, "last_held", plain)
    assert usable_range(case, ready, (routine,), root_seed=3, draws=1) == quick
    assert quick.focus_um[0] < 0 < quick.focus_um[1]
    size = (case.window.rows, case.window.columns)
    assert [p.shape for p in quick.pictures if p is not None] == [size] * 4
    # out of focus neighbours differ less than at the ends of the zoom, which are sharp
    steps = [
        float(np.diff(p.astype(float)).std()) for p in quick.pictures if p is not None
    ]
    assert max(steps[:2]) < min(steps[2:])


def test_a_few_draws_show_how_far_and_all_are_made_there(look: Look) -> None:
    """The last drift is the one of all draws at every drift, for fewer images."""
    case, ready = look("post"), prepare(look("post"), [("circle_caliper",)])
    search = ToleranceSearch(case=case, prepared=ready, root_seed=3, draws=8)
    farther, asked = Direction("zoom", 1), []

    def passes(outcome: Outcome) -> bool:
        asked.append(outcome.trial)
        return abs(outcome.distance_um) < (0.35 if outcome.trial > 5 else 0.5)

    found = search.reached(farther, passes)
    few = len(asked)
    # judged together, too, they are all made at every drift
    whole = search.reached(farther, passes, lambda _drift, _outcomes: True)
    assert found.drift == whole.drift > 0
    assert few < len(asked) - few
    assert set(asked[:few]) == set(range(8))


def test_no_draw_is_made_after_one_that_does_not_pass(look: Look) -> None:
    case, ready = look("post"), prepare(look("post"), [("circle_caliper",)])
    search = ToleranceSearch(case=case, prepared=ready, root_seed=3, draws=3)
    farther, made, together = Direction("zoom", 1), [0], [0]

    def whole(drift: float, found: Sequence[Outcome]) -> bool:
        together[0] += 1
        return len(found) == 3 and drift <= ZOOM[2]

    def near(outcome: Outcome) -> bool:
        made[0] += 1
        return outcome.trial == 0  # the second draw of every drift is refused

    assert search.reached(farther, lambda _: True, whole).drift == ZOOM[2]
    asked, together[0] = together[0], 0
    assert search.reached(farther, near, whole).drift == 0
    assert (made[0], together[0]) == (2 * 3, 0)  # of the fourth, second and first step
    assert asked == 3  # of the fourth, second and third
