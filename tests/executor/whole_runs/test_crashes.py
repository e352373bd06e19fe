"""Executors that are killed anywhere, and the next one that goes on."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from microplan.executor.simulated.cell import build_cell
from tests.executor.whole_runs.crashing import (
    ORDER_HOWS,
    Fate,
    Job,
    Ledger,
    all_fates,
    hurried,
    live,
    outcome,
    pairs,
    small_job,
)

EVERY = 59  # benchmarks/executing/crashes.py takes every one
TWICE = 12


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Job:
    """Return the small assembly."""
    return small_job(tmp_path_factory.mktemp("crashes") / "gear.plan")


@pytest.fixture(autouse=True)
def _hurried() -> Iterator[None]:
    with hurried():
        yield


@pytest.fixture(scope="module")
def fates(job: Job) -> list[Fate]:
    """Return all ways to die at the job."""
    with hurried():
        return all_fates(job)


def test_a_killed_executor_is_followed_by_one_that_ends_the_job(
    job: Job, fates: list[Fate]
) -> None:
    found = [outcome(job, (fate,)) for fate in fates[::EVERY]]
    assert [(o.fates, o.wrong) for o in found if o.wrong] == []
    assert all(o.met for o in found)
    assert {o.fates[0].how for o in found} == {fate.how for fate in fates}


@pytest.mark.slow
def test_executors_killed_while_they_recover_are_followed_too(
    job: Job, fates: list[Fate]
) -> None:
    found = [outcome(job, pair) for pair in pairs(fates, TWICE)]
    assert [(o.fates, o.wrong) for o in found if o.wrong] == []
    assert sum(o.met for o in found) > TWICE / 2


@pytest.mark.slow
def test_axes_that_were_brought_away_for_a_look_are_taken_back(job: Job) -> None:
    """By a probe, or near a look; whoever takes over begins where the step began."""
    whole = outcome(job, (Fate(0, "before"),)).orders
    moves = [i for i, order in enumerate(whole) if order.startswith("stage")]
    warm_start = next(k for k, i in enumerate(moves) if "-595.0" in whole[i])
    assert warm_start >= 3  # two short moves of the probe, and its way back, at least
    home = whole[moves[warm_start + 1]]
    assert "'x_um': -600.0, 'y_um': 0.0" in home
    assert whole[moves[warm_start - 1]] == home  # the probe's way back
    for number in moves[: warm_start + 2]:
        for how in ORDER_HOWS:
            found = outcome(job, (Fate(number, how),))
            assert not found.wrong
            stage = [order for order in found.orders if order.startswith("stage")]
            first = next(i for i, order in enumerate(stage) if "-180" in order)
            assert stage[first - 1] == home


def test_a_half_done_insertion_is_asked_about_and_nothing_moves(job: Job) -> None:
    ledger = Ledger(build_cell(job.world, 0))
    whole = Ledger(build_cell(job.world, 0))
    live(job, whole)
    insert = next(i for i, o in enumerate(whole.orders) if "'z_um': 0.0" in o)
    assert live(job, ledger, Fate(insert, "half")).code == ""
    orders, lines = len(ledger.orders), bytes(ledger.disk)
    refused = live(job, ledger)
    assert refused.code == "MP864"
    assert "on its way from -260 to 0" in refused.message
    assert live(job, ledger, ask=lambda _: False).code == "MP864"
    assert len(ledger.orders) == orders
    assert bytes(ledger.disk) == lines
    questions: list[str] = []

    def ask(question: str) -> bool:
        questions.append(question)
        return True

    assert live(job, ledger, ask=ask).code is None
    assert len(questions) == 1
    assert ledger.cell.judge("gear", "shaft_plate.post").success
    assert not ledger.wrong


def killed_in_the_grasp(job: Job) -> Ledger:
    """Return what is left of an executor that died when it had closed the jaws."""
    ledger, whole = (Ledger(build_cell(job.world, 0)) for _ in range(2))
    live(job, whole)
    grasp = next(i for i, o in enumerate(whole.orders) if o.startswith("gripper"))
    live(job, ledger, Fate(grasp, "after"))
    ledger.cell.timeline.advance(1.0)
    return ledger


def test_an_executor_that_did_not_sense_would_be_caught(
    job: Job, monkeypatch: pytest.MonkeyPatch
) -> None:
    ledger = killed_in_the_grasp(job)
    monkeypatch.setattr("microplan.executor.run.resume.decide", lambda *_: "not begun")
    live(job, ledger)
    assert any("although the jaws did that" in word for word in ledger.wrong)


def test_an_intent_written_too_late_leaves_a_station_that_is_refused(job: Job) -> None:
    ledger = killed_in_the_grasp(job)
    last = bytes(ledger.disk).splitlines(keepends=True)[-1]
    assert b'"kind": "intent"' in last
    del ledger.disk[-len(last) :]
    orders = len(ledger.orders)
    refused = live(job, ledger)
    assert refused.code == "MP865"
    assert refused.message == "jaws.opening_um reads 96, it was at 130"
    assert len(ledger.orders) == orders
