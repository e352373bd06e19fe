"""Images of looks, planned and made: what is counted when, and what is left."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from microplan.planner.looks.progress.work import (
    STAGES,
    CompileProgress,
    Images,
    Stage,
    Work,
    planned_images,
    telling,
)
from tests.planner.examples import FEW

RACE, OTHERS, PAIRS, RANGE, TRIALS = STAGES
PLANNED = dict(zip(STAGES, planned_images(FEW), strict=True))
ALL = sum(PLANNED.values())


@pytest.fixture
def heard() -> list[CompileProgress]:
    """Return what is heard of the work."""
    return []


@pytest.fixture
def work(heard: list[CompileProgress]) -> Work:
    """Return the work of two looks, of which nothing is made."""
    found = Work(heard=heard.append)
    found.plan(["a", "b"], FEW)
    found.step(0, 2, "first")
    return found


def test_nothing_is_made_at_first(work: Work, heard: list[CompileProgress]) -> None:
    assert heard[-1] == CompileProgress(
        step="first", look="", stage="", steps=0, all_steps=2,
        here=Images(), all=Images(0.0, 2 * ALL),
    )  # fmt: skip
    assert PLANNED[OTHERS] == 0
    assert min(PLANNED[stage] for stage in (RACE, PAIRS, RANGE, TRIALS)) > 0


def test_images_are_counted_in_the_look_that_they_are_of(
    work: Work, heard: list[CompileProgress]
) -> None:
    work.told("a")(RACE, 2)
    work.told("b")(RACE, 3)
    assert heard[-1].look == "b"
    assert heard[-1].stage == RACE
    assert heard[-1].here.made == 3
    assert heard[-1].all.made == 5
    assert heard[-1].all.needed == 2 * ALL


def test_a_stage_that_ends_early_leaves_nothing_to_be_made(
    work: Work, heard: list[CompileProgress]
) -> None:
    told = work.told("a")
    told(RACE, 1)
    told(PAIRS, 0)
    assert heard[-1].stage == PAIRS
    assert heard[-1].here.made == pytest.approx(PLANNED[RACE])
    assert heard[-1].here.needed == pytest.approx(ALL)


def test_what_a_cache_has_is_neither_made_nor_to_be_made(
    work: Work, heard: list[CompileProgress]
) -> None:
    work.told("a")(TRIALS, 1)  # the first of it that is computed
    assert heard[-1].here == Images(1, PLANNED[TRIALS])
    work.told("b")
    work.ended("b")  # all of it
    work.say()
    assert heard[-1].here == Images()
    assert heard[-1].all == Images(1, PLANNED[TRIALS])


def test_more_than_planned_is_needed_once_it_is_made(
    work: Work, heard: list[CompileProgress]
) -> None:
    told = work.told("a")
    told(RACE, PLANNED[RACE])
    told(OTHERS, 7)
    told(TRIALS, PLANNED[TRIALS] + 5)
    want = PLANNED[RACE] + 7 + PLANNED[TRIALS] + 5
    assert heard[-1].here == Images(want, want)


def test_a_look_that_was_not_planned_counts_for_nothing(
    work: Work, heard: list[CompileProgress]
) -> None:
    work.told("c")(RACE, 4)
    work.ended("c")
    assert heard[-1].stage == ""
    assert heard[-1].all == Images(0.0, 2 * ALL)


def test_a_look_made_ahead_counts_and_is_not_the_present_one(
    work: Work, heard: list[CompileProgress]
) -> None:
    work.told("a")(RACE, 1)
    work.counting("b")(RACE, 2)
    assert heard[-1].look == "a"
    assert heard[-1].here.made == 1
    assert heard[-1].all.made == 3


def test_a_map_that_tells_is_the_map() -> None:
    heard: list[tuple[Stage, float]] = []

    def told(stage: Stage, images: float) -> None:
        heard.append((stage, images))

    def lazy(items: list[str]) -> Iterator[int]:
        yield from telling(map, told, RACE, len)(len, items)

    found = lazy(["a", "bcd"])
    assert next(found) == 1
    assert heard == [(RACE, 0), (RACE, 1)]
    assert list(found) == [3]
    assert heard == [(RACE, 0), (RACE, 1), (RACE, 3)]
    assert list(lazy([])) == []
    assert len(heard) == 3
