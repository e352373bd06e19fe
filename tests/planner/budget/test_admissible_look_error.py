"""What an insertion bears of the look before it, by its chance with that error."""

from __future__ import annotations

from dataclasses import replace

import pytest

from microplan.planner.assembly.step_states import unfold
from microplan.planner.budget.alignment_residual import residual_after
from microplan.planner.budget.allowable_errors import AdmissibleError, admissible_errors
from microplan.planner.budget.budget import PastMeasurement
from microplan.planner.budget.insert_budget import insertion_of, share_of_goal
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from tests.planner.examples import down_the_bore
from tests.planner.placed import look, read

WITHIN_UM = 1.45


def seen_in_gear() -> dict[str, PastMeasurement]:
    """Return the looks before the gear is aligned, in round numbers."""
    shaft = look("shaft_plate.post", "find_shaft", 1.4)
    return {
        "gear": look("gear.bore", "gear_in_fingers", 0.05),
        # most of it is the zoom's scale
        "shaft_plate": replace(shaft, sigma_without_scale_um=0.3),
    }


def probability(task: Task, sigma_um: float, magnification: float = 1.0) -> float:
    """Return P(insertion) after a look over the shaft with this sigma and zoom."""
    states = unfold(task, Report())
    align, insert = (
        next(s for s in states if s.step.id == name)
        for name in ("over_shaft", "insert")
    )
    seen = seen_in_gear()
    left = residual_after(task, align, "servo", WITHIN_UM, seen["shaft_plate"])
    last = look("shaft_plate.post", "over_shaft", sigma_um)
    seen["shaft_plate"] = replace(
        last, magnification=magnification * last.magnification
    )
    job = insertion_of(task, states, insert, left, seen)
    assert job is not None
    return 1 - job.miss


def borne_by(
    task: Task, seen: dict[str, PastMeasurement], step: str = "over_shaft"
) -> AdmissibleError:
    states = unfold(task, Report())
    align = next(s for s in states if s.step.id == step)
    return admissible_errors(task, states, align, WITHIN_UM, seen)


def test_what_an_insertion_bears_of_its_look_gives_just_its_share() -> None:
    task = read(down_the_bore())
    borne = borne_by(task, seen_in_gear()).admissible_um
    assert borne is not None
    share = share_of_goal(task)
    # the root is found to a thousandth of the size, where P falls by some .1 per um
    assert probability(task, borne / 2) == pytest.approx(share, abs=1e-3)
    assert (
        probability(task, 0.9 * borne / 2) > share > probability(task, 1.1 * borne / 2)
    )


@pytest.mark.parametrize(
    "magnification", [1.01, pytest.param(2.0, marks=pytest.mark.slow), 6.0]
)
def test_a_look_is_worth_keeping_until_a_faultless_one_elsewhere_is_as_likely(
    magnification: float,
) -> None:
    """The jump of the zoom costs 1 um, whichever other zoom it is."""
    task = read(down_the_bore())
    found = borne_by(task, seen_in_gear())
    assert found.admissible_um is not None
    assert found.break_even_um is not None
    elsewhere = probability(task, 0.0, magnification)
    assert elsewhere < share_of_goal(task)
    assert probability(task, found.break_even_um / 2) == pytest.approx(
        elsewhere, abs=2e-3
    )
    assert found.break_even_um > found.admissible_um


def test_without_a_jump_another_zoom_is_worth_it() -> None:
    task = read(down_the_bore())
    optics = task.workcell.optics
    zoom = replace(optics.zoom, parcentric_sigma_um=0.0)
    cell = replace(task.workcell, optics=replace(optics, zoom=zoom))
    found = borne_by(replace(task, workcell=cell), seen_in_gear())
    assert found.admissible_um is not None
    assert found.break_even_um is None


def test_nothing_is_borne_where_nobody_asks() -> None:
    task, seen = read(down_the_bore()), seen_in_gear()
    assert (
        borne_by(task, seen, "bring_between") == AdmissibleError()
    )  # no insertion follows
    assert borne_by(task, {}) == AdmissibleError()  # nothing was seen
    assert borne_by(replace(task, success_goal=None), seen) == AdmissibleError()
