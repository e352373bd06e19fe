"""Chains that wait: no trial of theirs could change the choice, and none is lost."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from microplan.featuresel.look.design import Trial, design
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Principle
from microplan.featuresel.selection.constraints import Constraints
from microplan.featuresel.selection.evaluate import compare_routines
from microplan.featuresel.selection.race import SHOWN, Heats, chains_ahead, race
from microplan.featuresel.selection.select import Selection, select
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.outcomes import Outcome
from microplan.featuresel.trials.score import ChainScore
from microplan.featuresel.trials.trials import PreparedRoutines, prepare
from tests.featuresel.selection.test_select import a_score, with_failures

Look = Callable[[str], LookCase]

TASK = Constraints(tolerance_um=1.0, tolerance_theta_rad=None)


def selected(scores: Sequence[ChainScore]) -> Selection:
    return select(scores, Constraints(tolerance_um=1.0, tolerance_theta_rad=None))


def hung_on(*scores: ChainScore) -> set[Chain]:
    return set(chains_ahead(scores, selected(scores), TASK))


def test_what_costs_more_than_a_roomy_chain_and_its_fallback_waits() -> None:
    found = hung_on(
        a_score("a", 0.1, 2), a_score("b", 0.1, 4), a_score("a>c", 0.01, 3),
        a_score("c", 0.01, 5), with_failures(a_score("d", 0.1, 1), 64, 0),
        a_score("b>c", 0.01, 6),
    )  # fmt: skip
    assert found == {("a",), ("b",), ("d",)}


@pytest.mark.parametrize(
    "scores",
    [
        [a_score("a", 0.3, 1), a_score("b", 0.1, 2), a_score("c", 0.1, 3)],
        [a_score("a", 0.1, 1), a_score("b", 0.3, 2), a_score("c", 0.29, 3)],
        [a_score("a", 0.6, 1), a_score("b", 0.6, 2)],
    ],
    ids=["tight", "tight fallback", "none passes"],
)
def test_where_no_two_leave_room_all_matter(scores: list[ChainScore]) -> None:
    assert hung_on(*scores) == {score.chain for score in scores}


def test_what_has_less_in_common_than_the_fallback_matters_at_any_cost() -> None:
    alike = [a_score("a", 0.1, 1), a_score("a>b", 0.1, 2), a_score("a>c", 0.1, 3)]
    assert hung_on(*alike) == {("a",), ("a", "b")}
    begun_apart = with_failures(a_score("d", 0.1, 8), 64, 0)
    assert hung_on(*alike, begun_apart) == {("a",), ("a", "b"), ("d",)}
    edges = replace(with_failures(a_score("a>e", 0.1, 9), 64, 0), principle="edges")
    assert hung_on(*alike, begun_apart, edges) == {
        ("a",), ("a", "b"), ("d",), ("a", "e"),
    }  # fmt: skip


NAMES = ["a", "b", "c", "a>b", "a>c", "b>c", "b>a", "c>b"]
SIGMAS = st.sampled_from([0.01, 0.1, 0.2, 0.3, 0.45, 0.6])
FAULTS = st.sampled_from([0, 0, 0, 1, 5])


@st.composite
def fields(draw: st.DrawFn) -> tuple[list[ChainScore], list[ChainScore]]:
    """Return scores of some chains twice: costs are the same, all else is not."""
    names = draw(st.lists(st.sampled_from(NAMES), min_size=1, unique=True))
    costs = [draw(st.sampled_from([1.0, 2.0, 3.0, 4.0])) for _ in names]
    kinds: list[Principle] = [draw(st.sampled_from(["edges", "area"])) for _ in names]
    first, second = (
        [
            with_failures(
                replace(a_score(name, draw(SIGMAS), cost), principle=kind),
                draw(FAULTS),
                draw(FAULTS),
            )
            for name, cost, kind in zip(names, costs, kinds, strict=True)
        ]
        for _ in range(2)
    )
    return first, second


@given(fields())
def test_whatever_a_waiting_chain_shows_the_choice_stays(
    both: tuple[list[ChainScore], list[ChainScore]],
) -> None:
    scores, other = both
    found = selected(scores)
    kept = chains_ahead(scores, found, TASK)
    mixed = [s if s.chain in kept else o for s, o in zip(scores, other, strict=True)]
    again = selected(mixed)
    assert again.chosen == found.chosen
    assert again.fallback == found.fallback


def heats_of(case: LookCase, script: dict[int, set[str]]) -> tuple[Heats, list[str]]:
    """Return heats that note who is tried, and of whom the choice hangs by trials."""
    noted: list[str] = []
    chains = tuple((name,) for name in "abc")

    def run(racing: PreparedRoutines, trials: Sequence[Trial]) -> list[Outcome]:
        names = "".join(name for (name,) in racing.chains)
        noted.append(f"{names} {trials[0].index}..{trials[-1].index}")
        return []

    def scored(
        racing: PreparedRoutines, _: Sequence[Outcome]
    ) -> tuple[ChainScore, ...]:
        return tuple(
            replace(a_score(name), trials=heats.done.get((name,), 0))
            for (name,) in racing.chains
        )

    heats = Heats(
        prepared=PreparedRoutines(chains=chains, artifacts={}),
        trials=design(case, 128, 1),
        run=run,
        scored=scored,
        judged=scored,
        ahead=lambda scores: {(n,) for n in script[max(s.trials for s in scores)]},
    )
    return heats, noted


def test_who_waited_makes_up_for_all_that_was_missed(look: Look) -> None:
    heats, noted = heats_of(look("post"), {24: {"a"}, 64: {"a"}, 128: {"a", "b"}})
    for end in (8, SHOWN, 64, 128):
        scores = heats.round(end)
    assert noted == ["abc 0..7", "abc 8..23", "a 24..63", "a 64..127", "b 24..127"]
    assert heats.done == {("a",): 128, ("b",): 128, ("c",): SHOWN}
    assert [score.chain for score in scores] == [("a",), ("b",)]


def test_a_race_with_waiting_chains_chooses_what_one_without_does(look: Look) -> None:
    case = replace(look("post"), tolerance_um=0.8)
    task = replace(TASK, tolerance_um=0.8)
    ready = prepare(case, [("otsu",), ("ncc",), ("circle_caliper",)])

    def choice(scores: Sequence[ChainScore]) -> Selection:
        return select(scores, Constraints(tolerance_um=0.8, tolerance_theta_rad=None))

    held = partial(race, case, ready, root_seed=3, most=40, rounds=(8, 24))
    some = held(ahead=lambda scores: chains_ahead(scores, choice(scores), task))
    whole = held()
    assert choice(some.scores).chosen == choice(whole.scores).chosen
    assert choice(some.scores).fallback == choice(whole.scores).fallback
    assert some.trials == {("otsu",): SHOWN, ("ncc",): 40, ("circle_caliper",): 40}
    assert set(whole.trials.values()) == {40}
    assert set(some.outcomes) < set(whole.outcomes)


def test_a_chain_that_fell_is_judged_with_the_others_and_tried_no_more(
    look: Look,
) -> None:
    """It may still pass, and so decide what a choice without room is."""
    heats, noted = heats_of(look("post"), {24: {"a"}, 64: {"a", "b"}})
    for end in (8, SHOWN):
        heats.round(end)
    judged: list[tuple[Chain, ...]] = []
    ahead = heats.ahead
    assert ahead is not None

    def watched(scores: Sequence[ChainScore]) -> Collection[Chain]:
        judged.append(tuple(score.chain for score in scores))
        return ahead(scores)

    heats.ahead = watched
    heats.left((), [(("b",), "is dearer")])
    heats.round(64)
    assert set(judged) == {(("a",), ("b",), ("c",))}
    assert noted[2:] == ["a 24..63"]


@pytest.mark.slow
def test_who_wants_all_chains_to_the_end_has_them(look: Look) -> None:
    case = replace(look("post"), tolerance_um=0.8)
    waiting, whole = (
        compare_routines(
            case, root_seed=3, most=30, limited=False, to_the_end=to_the_end
        )
        for to_the_end in (False, True)
    )
    passing = {s.chain for s in whole.scores if s.success == s.trials}
    assert {s.trials for s in whole.scores if s.chain in passing} == {30}
    assert {s.trials for s in waiting.scores if s.chain in passing} == {SHOWN, 30}
    assert waiting.selection.chosen == whole.selection.chosen
