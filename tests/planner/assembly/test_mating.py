"""How hole and shaft mate: against worst cases drawn and geometry solved apart."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize

from microplan.planner.assembly.mating import Mating, fit_verdict, mating_of
from microplan.planner.assembly.step_states import unfold
from microplan.planner.source.diagnostics import Report
from microplan.planner.views.check_task import check_fits
from tests.planner.examples import EXAMPLE, change, copy_example, read


def mating(shaft_um: float, engaged_um: float = 100.0, friction: float = 0.3) -> Mating:
    return Mating(
        hole_um=50.0, shaft_um=shaft_um, tolerance_um=1.2, taper_um=0.2,
        engaged_um=engaged_um, friction=friction,
    )  # fmt: skip


def test_the_example_mates_as_its_drawings_say() -> None:
    task = read(EXAMPLE / "task.yaml")
    insert = next(s for s in unfold(task, Report()) if s.step.verb == "insert")
    found = mating_of(task, insert.step, insert.after)
    assert found is not None
    # the gear rests on the plate, 100 um of the post's 250 um inside it; both edges of
    # both parts are off by 0.3 um at most, and the gear's walls lean 0.1 um a side
    assert found.engaged_um == pytest.approx(100.0)
    assert found.clearance_um == pytest.approx((6 - 1.2 - 0.2, 6.0, 7.2), abs=1e-6)
    verdict = fit_verdict(found, 0.002)
    assert verdict.fit == "clearance"
    assert verdict.capture_um == pytest.approx((2.3, 3.0, 3.6), abs=1e-6)
    assert verdict.tilt_takes_um == pytest.approx(0.6, abs=1e-4)
    assert not verdict.may_wedge


def test_the_numbers_of_a_wide_bore() -> None:
    """400 mrad for 6 um in 50 um at a friction of .3; geometry caps tilt at 60."""
    found = mating(44.0)
    assert found.wedging_rad(6.0) == pytest.approx(0.4)
    assert found.tilt_limit_rad(6.0) == pytest.approx(0.06)
    assert found.wedging_depth_um == pytest.approx(15.0)


@pytest.mark.parametrize(
    ("shaft_um", "wanted"),
    [(44.0, "clearance"), (48.5, "clearance"), (49.0, "transition"),
     (50.5, "transition"), (51.3, "interference")],
)  # fmt: skip
def test_the_class_is_what_parts_drawn_at_random_do(
    shaft_um: float, wanted: str
) -> None:
    found = mating(shaft_um)
    rng = np.random.default_rng(5)
    edges = rng.uniform(-0.3, 0.3, (100_000, 2)).sum(axis=1) * 2  # both diameters
    lean = rng.uniform(0.0, 0.2, 100_000)
    goes = 50.0 - shaft_um + edges - lean > 0
    seen = {True: "clearance", False: "transition"}[bool(goes.all())]
    assert found.fit_class == wanted
    assert ("interference" if not goes.any() else seen) == wanted


@settings(max_examples=60, deadline=None)
@given(st.floats(0.05, 8.0), st.floats(20.0, 400.0))
def test_the_tilt_limit_is_where_a_tilted_shaft_touches_both_ends(
    clearance_um: float, engaged_um: float
) -> None:
    """A shaft of width d leaning by t spans d / cos t + L tan t of the hole's width."""
    shaft_um = 50.0 - clearance_um

    def spare(tilt: float) -> float:
        return 50.0 - shaft_um / math.cos(tilt) - engaged_um * math.tan(tilt)

    exact = optimize.brentq(spare, 0.0, 0.9)
    found = mating(shaft_um, engaged_um).tilt_limit_rad(clearance_um)
    assert found is not None
    # c / L leaves out d t**2 / 2 + L t**3 / 3 <= 25 t**2 + L t**3 / 3 of the width
    left_out = (25 * found**2 + engaged_um * found**3 / 3) / engaged_um
    assert 0 <= found - exact <= left_out * (1 + found) + 1e-9


def holds_itself(ratio: float, tilt: float, friction: float) -> bool:
    """Return whether a shaft that touches both sides of a hole can hold by itself.

    Hole 1 wide, shaft 1 - ratio, in the plane. Its lower corner touches the left wall,
    its right side the mouth. Forces inside both friction cones, not all zero, that
    balance in x, z and moment: a linear program over the cones' four edges.
    """
    width = 1 - ratio
    up = np.array([math.sin(tilt), math.cos(tilt)])
    across = np.array([math.cos(tilt), -math.sin(tilt)])
    along = (1 - width * math.cos(tilt)) / math.sin(tilt)  # of the side, to the mouth
    corner = np.zeros(2)
    mouth = width * across + along * up
    assert mouth[0] == pytest.approx(1.0)
    columns = []
    for point, normal in ((corner, np.array([1.0, 0.0])), (mouth, -across)):
        aside = np.array([-normal[1], normal[0]])
        for sign in (1, -1):
            force = normal + sign * friction * aside
            moment = point[0] * force[1] - point[1] * force[0]
            columns.append([*force, moment, 1.0])  # the last: some force at all
    wrench = np.array(columns).T
    found = optimize.linprog(np.zeros(4), A_eq=wrench, b_eq=[0.0, 0.0, 0.0, 1.0])
    return bool(found.status == 0)


@pytest.mark.parametrize("friction", [0.2, 0.3, 0.6])
@pytest.mark.parametrize("ratio", [0.0003, 0.001])
def test_no_contact_wedges_below_the_limit(ratio: float, friction: float) -> None:
    """By forces in both friction cones; the limit leaves out t**2 of the tilt."""
    whole = Mating(
        hole_um=50.0, shaft_um=50.0 * (1 - ratio), tolerance_um=0.0, taper_um=0.0,
        engaged_um=100.0, friction=friction,
    )  # fmt: skip
    limit = whole.wedging_rad(50.0 * ratio)
    assert limit is not None
    for share in (0.5, 0.9, 0.999):
        assert not holds_itself(ratio, share * limit, friction)
    # (ratio - t**2 / 2) / t = tan(atan(mu) - t) at t = limit (1 + x), to first order
    x = (0.5 + friction**2) * ratio / friction**2
    assert not holds_itself(ratio, limit * (1 + x / 2), friction)
    assert holds_itself(ratio, limit * (1 + 2 * x), friction)


def test_a_short_hole_does_not_wedge_before_it_touches_both_sides() -> None:
    """Deep enough to wedge is 15 um; of 5 um, tilts up to c / L touch one side."""
    short = mating(44.0, engaged_um=5.0)
    assert short.wedging_rad(6.0) == pytest.approx(0.4)
    assert short.tilt_limit_rad(6.0) == pytest.approx(1.2)
    assert not short.may_wedge(6.0, 0.8)
    assert short.may_wedge(6.0, 1.3)
    deep = mating(44.0)
    assert not deep.may_wedge(6.0, 0.39)
    assert deep.may_wedge(6.0, 0.41)
    assert not mating(44.0, engaged_um=0.0).may_wedge(6.0, 1.5)


def test_no_room_captures_nothing() -> None:
    found = fit_verdict(mating(49.0), 0.002)
    assert found.clearance_um[0] == pytest.approx(-0.4)
    assert found.capture_um == pytest.approx((0.0, 0.5, 1.1))


def test_without_friction_or_overlap_there_is_no_limit() -> None:
    assert mating(44.0, friction=0.0).wedging_rad(6.0) is None
    assert mating(44.0, engaged_um=0.0).tilt_limit_rad(6.0) is None
    verdict = fit_verdict(mating(44.0, engaged_um=0.0, friction=0.0), 0.002)
    assert verdict.tilt_takes_um == 0.0
    assert not verdict.may_wedge


@pytest.mark.parametrize(
    ("file", "old", "new", "codes"),
    [
        ("task.yaml", "friction: 0.3", "friction: 0.3 ", [("MP610", "note")]),
        ("parts/shaft_plate.dxf", "22.0", "24.8", [("MP610", "warning"),
                                                   ("MP611", "warning")]),
        ("parts/shaft_plate.dxf", "22.0", "25.5", [("MP601", "infeasible")]),
        ("workcell.yaml", "tilt_sigma_mrad: 2", "tilt_sigma_mrad: 200",
         [("MP610", "note"), ("MP611", "warning")]),
        ("task.yaml", "move: [{stage: {z_um: 0}}], speed",
         "move: [{stage: {z_um: -255}}], speed", [("MP610", "infeasible")]),
    ],
)  # fmt: skip
def test_fits_are_reported_with_their_numbers(
    tmp_path: Path, file: str, old: str, new: str, codes: list[tuple[str, str]]
) -> None:
    task_file = copy_example(tmp_path / "task")
    change(task_file.parent / file, old, new)
    task, report = read(task_file), Report()
    check_fits(task, unfold(task, Report()), report)
    assert [(d.code, d.severity) for d in report.in_order] == codes
    assert all(" um" in d.message and d.where.line for d in report.found)
