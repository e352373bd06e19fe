"""Adhesion: magnitudes against published ones, intervals that behave, verdicts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import constants, integrate

from microplan.planner.assembly.shapes import squeeze_width_um
from microplan.planner.assembly.step_states import StepState, unfold
from microplan.planner.budget.step_budget import report_handling, verdicts_of
from microplan.planner.mechanics.adhesion import (
    CONTACT_UM,
    DRY,
    SLIT_UM,
    SLOPE,
    ContactFace,
    forces,
    total,
    verdict,
)
from microplan.planner.mechanics.gripping import stiffness_un_per_um
from microplan.planner.mechanics.releasing import release_verdict
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Environment, Task
from microplan.schemas.plan.verdicts import Force
from microplan.schemas.pose import Pose
from tests.planner.examples import EXAMPLE, change, copy_example, read

TIP = ContactFace(area_um2=870.0, conducts=True)  # a tooth 8.7 um wide, 100 um high
CELL = Environment()
FOUR_DIGITS = 5e-5  # to which constants are written


def named(face: ContactFace, environment: Environment) -> dict[str, Force]:
    return {force.name: force for force in forces(face, environment)}


def released(task: Task) -> tuple[tuple[StepState, ...], StepState]:
    states = unfold(task, Report())
    return states, next(s for s in states if s.step.verb == "release")


def test_every_force_reaches_micronewtons_but_none_is_one_number() -> None:
    """0.05 to 20 uN for parts of this size, as surveys of sticking effects have it."""
    found = named(TIP, replace(CELL, grounded=False))
    assert set(found) == {
        "van der Waals", "capillary", "charge", "contact potential"
    }  # fmt: skip
    for force in found.values():
        assert 0.05 < force.most_un < 20.0
        assert force.least_un < force.most_un / 10
        assert force.validity


def test_forces_are_those_of_the_textbook() -> None:
    found = named(TIP, CELL)
    # one asperity of 20 nm, 0.5e-19 J: A R / 6 D**2 = 6.1 nN
    assert found["van der Waals"].least_un == pytest.approx(3 * 6.12e-3, rel=2e-3)
    # blunt ones of 1.414 um, 4e-19 J, and 2.65e3 N/m2 over the face
    blunt = 3 * 4e-19 * 1.4142e-6 / (6 * 0.165e-9**2) * 1e6
    behind = 4e-19 / (6 * math.pi * 20e-9**3) * 870e-12 * 1e6
    assert found["van der Waals"].most_un == pytest.approx(blunt + behind, rel=1e-3)
    assert "50..400 zJ" in found["van der Waals"].validity
    # a body as wide as the face: 4 pi gamma R = 0.915 uN a um
    assert found["capillary"].most_un == pytest.approx(0.9148 * TIP.radius_um, rel=1e-3)
    # two plates 20 nm apart at 1 V: 11.07 kN/m2
    assert found["contact potential"].most_un == pytest.approx(9.629, rel=1e-3)
    # 43.6 V/um, the Paschen minimum: 8416 N/m2, and N/m2 is 1e-6 uN/um2
    charged = named(TIP, replace(CELL, grounded=False))["charge"]
    assert charged.most_un == pytest.approx(8416e-6 * 870.0, rel=1e-3)


def summed_pressure(gap_um: float) -> float:
    """Return the pull of two half spaces per area over A, pair by pair.

    All pairs attract by -C / r**6 and A = pi**2 C n1 n2. The force of a half space on a
    point d away along the normal, rings of radius s at height z integrated numerically;
    then over the depth of the points in the other half space.
    """

    def on_point(away: float) -> float:
        def ring(s: float, z: float) -> float:
            r2 = s * s + z * z
            return 2 * math.pi * s * 6 * z / r2**4

        # lengths in units of `away`: the integral falls as its fourth power
        unit = integrate.dblquad(ring, 1.0, math.inf, 0.0, math.inf)[0]
        return unit / away**4

    depth = integrate.quad(lambda d: d**-4.0, gap_um, math.inf)[0]
    return on_point(1.0) * depth / math.pi**2


def test_faces_attract_as_the_sum_of_their_molecules() -> None:
    gap_um = 0.02
    assert summed_pressure(gap_um) == pytest.approx(
        1 / (6 * math.pi * gap_um**3), rel=1e-6
    )
    # twice the area adds the pull of that area, nothing else, while asperities are
    # small beside the face
    pulls = [
        named(ContactFace(area_um2=a), CELL)["van der Waals"].most_un
        for a in (1e3, 2e3)
    ]
    assert pulls[1] - pulls[0] == pytest.approx(4e-7 * 1e3 * summed_pressure(gap_um))


def test_an_asperity_attracts_as_the_rings_of_its_cap() -> None:
    """A sphere near a plane is a stack of rings, each as far away as it is."""
    radius_um = 0.02

    def ring(s: float) -> float:
        away = CONTACT_UM + radius_um - math.sqrt(radius_um**2 - s * s)
        return 2 * math.pi * s / (6 * math.pi * away**3)

    cap = integrate.quad(ring, 0.0, radius_um, points=[CONTACT_UM], limit=200)[0]
    found = named(TIP, CELL)["van der Waals"].least_un / (3 * 0.5e-7)
    # the rest of the sphere is a radius away and more: (D0 / R)**2 of it
    assert found == pytest.approx(cap, rel=2 * CONTACT_UM / radius_um)


def hamaker_j(kappa: Callable[[float], float], scale_hz: float) -> float:
    """Return 3 h / 4 pi times the integral of kappa**2 over frequency (Lifshitz)."""
    area = integrate.quad(lambda x: kappa(x * scale_hz) ** 2, 0, math.inf)[0]
    return 3 * constants.h / (4 * math.pi) * area * scale_hz


def insulator_j(index: float) -> float:
    """Return the Hamaker constant of what absorbs at 3e15 Hz and has that index."""

    def kappa(hz: float) -> float:
        over = (index**2 - 1) / (1 + (hz / 3e15) ** 2)  # eps - 1
        return over / (over + 2)

    return hamaker_j(kappa, 3e15)


@pytest.mark.parametrize(
    ("index", "tension_n_per_m"), [(1.397, 0.0216), (1.411, 0.0238), (1.434, 0.0275)]
)
def test_contact_is_where_surface_tension_puts_it(
    index: float, tension_n_per_m: float
) -> None:
    """A / (24 pi D0**2) is half the work to part a column: octane to hexadecane."""
    contact_m = CONTACT_UM * 1e-6
    work = integrate.quad(lambda x: x**-3, 1.0, math.inf)[0] / (6 * math.pi)
    found = insulator_j(index) * work / contact_m**2 / 2
    assert found == pytest.approx(tension_n_per_m, rel=0.1)


def test_hamaker_constants_range_from_polymers_to_metals() -> None:
    plasma_hz = 15.3 * constants.e / constants.h  # aluminium

    def free(hz: float) -> float:
        return 1 / (1 + 2 * (hz / plasma_hz) ** 2)

    assert hamaker_j(free, plasma_hz) == pytest.approx(3.25e-19, rel=0.01)
    assert insulator_j(1.42) == pytest.approx(0.5e-19, rel=0.05)
    assert 0.5e-19 < insulator_j(1.6) < hamaker_j(free, plasma_hz) < 4e-19


def test_a_meniscus_pulls_a_round_body_by_its_pressure_times_its_area() -> None:
    """Laplace's pressure on what a ring of water wets, whatever its radius."""
    body_um = TIP.radius_um
    for ring_um in (1e-4, 1e-3, 1e-2):  # cross section: it touches sphere and plane
        # the centre of a circle that touches both is ring_um high, at sqrt(4 R r)
        edge_um = math.sqrt((body_um + ring_um) ** 2 - (body_um - ring_um) ** 2)
        inner_um = edge_um - ring_um  # of the neck
        pull = 0.0728 * (math.pi * inner_um**2 / ring_um - math.pi * inner_um)
        pull += 2 * math.pi * 0.0728 * inner_um  # the surface itself, at the neck
        found = named(TIP, CELL)["capillary"].most_un
        # the neck is narrower than what is wetted by sqrt(r / R) / 2 of it
        assert pull == pytest.approx(found, rel=1.1 * math.sqrt(ring_um / body_um))


def test_humid_air_floods_a_narrow_gap() -> None:
    """Kelvin: vapour condenses where gamma V / r = R T ln(1 / humidity), h = 2 r."""
    volume, gamma = 18.07e-6, 0.0728
    slit_um = 2 * gamma * volume / (constants.R * 293.15) * 1e6
    assert pytest.approx(slit_um, rel=5e-3) == SLIT_UM
    fills = math.exp(-SLIT_UM / CELL.roughness_um)
    assert 0.9 < fills < 0.96
    below = named(TIP, replace(CELL, humidity=fills - 0.01))["capillary"]
    above = named(TIP, replace(CELL, humidity=fills + 0.01))["capillary"]
    assert below.most_un < 20
    # pressure 2 gamma / h = 7.28 MPa over the face
    assert above.most_un == pytest.approx(7.28 * TIP.area_um2, rel=1e-6)
    assert SLIT_UM / math.log(1 / DRY) == pytest.approx(0.3e-3, rel=0.03)  # a molecule


def test_charge_pulls_by_the_energy_of_its_field() -> None:
    """Moved apart by dx at constant charge, the field fills A dx more."""
    face = ContactFace(area_um2=870.0)
    field = 327.0 / 7.5  # V/um
    energy_j = constants.epsilon_0 * (field * 1e6) ** 2 / 2 * face.area_um2 * 1e-12
    found = named(face, CELL)["charge"].most_un
    assert found == pytest.approx(energy_j * 1e6, rel=FOUR_DIGITS)
    # in the gap of a face 1 um wide and less, 350 V/um; between, the least voltage
    for width_um, volts_per_um in ((0.5, 350.0), (3.0, 109.0), (50.0, 43.6)):
        small = ContactFace(area_um2=math.pi * width_um**2 / 4)
        pressure = constants.epsilon_0 * (volts_per_um * 1e6) ** 2 / 2
        wanted = pressure * small.area_um2 * 1e-6
        assert named(small, CELL)["charge"].most_un == pytest.approx(wanted, rel=1e-3)


def test_contact_potential_pulls_as_a_capacitor_does() -> None:
    """-dU/dd of C V**2 / 2 with the source's work, by a central difference."""

    def charge_energy_uj(gap_um: float) -> float:
        return constants.epsilon_0 * 1e6 * 870.0 / gap_um / 2  # at 1 V; uN/V**2

    step = 1e-6
    gap = CELL.roughness_um
    pull = (charge_energy_uj(gap - step) - charge_energy_uj(gap + step)) / (2 * step)
    found = named(TIP, CELL)["contact potential"]
    assert found.most_un == pytest.approx(pull, rel=FOUR_DIGITS)
    assert found.least_un == 0.0  # like metals


def test_the_blunt_end_is_the_crest_of_a_gentle_sinusoid() -> None:
    x = np.linspace(0, 2 * math.pi, 4097)[:-1]
    height_um = CELL.roughness_um * math.sqrt(2) * np.cos(x)
    wave_um = np.sqrt(np.mean(np.gradient(height_um, x) ** 2)) / SLOPE  # 1 / k
    crest_um = wave_um**2 / -np.gradient(np.gradient(height_um, x), x)[2:-2].min()
    pulls = [
        named(replace(TIP, area_um2=a), CELL)["van der Waals"].most_un
        for a in (1e3, 2e3)
    ]
    blunt = (2 * pulls[0] - pulls[1]) / (3 * 4e-7 / (6 * CONTACT_UM**2))
    assert blunt == pytest.approx(crest_um, rel=1e-3)


def test_what_is_ruled_out_is_nothing() -> None:
    assert named(TIP, replace(CELL, humidity=0.0))["capillary"].most_un == 0.0
    assert named(TIP, CELL)["charge"].most_un == 0.0  # grounded
    unknown = replace(TIP, conducts=False)
    assert named(unknown, CELL)["charge"].most_un > 0  # earthed insulators hold it
    wet = named(replace(TIP, liquid=True), replace(CELL, humidity=1.0))
    assert wet["capillary"].most_un == 0.0
    assert wet["van der Waals"].least_un == 0.0
    assert "double layers" in wet["charge"].validity + wet["contact potential"].validity


def test_smoother_faces_hold_by_the_pressure_of_contact() -> None:
    """At no roughness the molecules touch: A / (6 pi D0**3), 0.5 GPa a face."""
    found = named(TIP, replace(CELL, roughness_um=0.0))
    per = 4e-7 / (6 * math.pi * CONTACT_UM**3)  # uN/um2 is MPa
    assert found["van der Waals"].most_un == pytest.approx(per * 870.0)
    assert found["van der Waals"].least_un == 0.0


@settings(max_examples=60, deadline=None)
@given(
    rough=st.floats(0.0, 1000.0), humid=st.floats(0, 1), area=st.floats(0, 1e8),
    grounded=st.booleans(), conducts=st.booleans(), liquid=st.booleans(),
)  # fmt: skip
def test_intervals_are_finite_and_in_order(
    rough: float,
    humid: float,
    area: float,
    grounded: bool,
    conducts: bool,
    liquid: bool,
) -> None:
    cell = Environment(humidity=humid, grounded=grounded, roughness_um=rough)
    face = ContactFace(area_um2=area, conducts=conducts, liquid=liquid)
    found = forces(face, cell)
    for force in found:
        assert 0 <= force.least_un <= force.most_un < math.inf
    larger = total(forces(replace(face, area_um2=2 * area), cell))
    # charge on a face below 7.5 um does not grow with it: rounding
    assert larger[1] >= total(found)[1] * (1 - 1e-12)


@pytest.mark.parametrize(
    ("pull", "hold", "wanted"),
    [
        ((0.1, 1.0), (2.0, 3.0), "stays"),
        ((0.1, 1.0), (0.5, 3.0), "may stick"),
        ((4.0, 9.0), (0.5, 3.0), "will stick"),
        ((0.0, 0.0), (0.0, 0.0), "stays"),
        ((1.0, 2.0), (0.0, 0.0), "will stick"),
    ],
)
def test_only_intervals_apart_decide(
    pull: tuple[float, float], hold: tuple[float, float], wanted: str
) -> None:
    assert verdict(pull, hold) == wanted


def test_a_shaft_strips_the_part_and_a_look_verifies() -> None:
    task = read(EXAMPLE / "task.yaml")
    states, here = released(task)
    found = release_verdict(task, states, here)
    assert found.verdict == "stays"
    assert "shaft" in found.reason
    assert found.verified_by == "check_seated"
    assert found.weight_un[0] == pytest.approx(44.6e-3, rel=0.02)
    assert found.pull_un == pytest.approx((0.0184, 31.9), rel=5e-3)  # docs/verdicts.md
    assert found.ladder[0].action == "open to 130 um"
    assert found.ladder[1].action == "look"
    assert found.ladder[-1].action.startswith("stop")


def test_the_shaft_must_bend_a_finger_off(tmp_path: Path) -> None:
    """Fingers stand as far apart as the part is wide, not as they were told to."""
    task = read(EXAMPLE / "task.yaml")
    states, here = released(task)
    width_um = squeeze_width_um(
        task.parts["gear"].outline, here.at_look.parts["gear"].pose.theta_rad
    )
    pull_un = release_verdict(task, states, here).pull_un[1]
    bends_um = pull_un / (stiffness_un_per_um(task.workcell.tools["tweezers"]) or 0.0)
    assert bends_um > 0.5
    least_um = width_um + 2 * (7.2 + bends_um)  # 7.2 um: the greatest clearance
    for opening_um, wanted in (
        (least_um + 0.1, "stays"),
        (least_um - 0.1, "may stick"),
    ):
        file = copy_example(tmp_path / f"task-{wanted}")
        old = "do: release, target: gear, opening_um: "
        change(file, f"{old}130", f"{old}{opening_um:.4f}")
        other = read(file)
        found = release_verdict(other, *released(other))
        assert found.verdict == wanted
        assert f"{bends_um:.3g} um" in found.reason


def test_fingers_of_unknown_stiffness_may_bend_any_way() -> None:
    task = read(EXAMPLE / "task.yaml")
    tool = replace(task.workcell.tools["tweezers"], youngs_modulus_gpa=None)
    task = replace(task, workcell=replace(task.workcell, tools={"tweezers": tool}))
    states, here = released(task)
    found = release_verdict(task, states, here)
    assert found.verdict == "may stick"
    assert "not stated" in found.reason


def lifted(task: Task, up_um: float) -> tuple[tuple[StepState, ...], StepState]:
    """Return the release of a gear that was raised, with its fingers, before."""
    states, here = released(task)
    robot = replace(here.at_look.robot, z_um=here.at_look.robot.z_um + up_um)
    high = replace(here, at_look=replace(here.at_look, robot=robot))
    return tuple(high if state is here else state for state in states), high


def test_what_may_not_conduct_below_may_hold_a_charge() -> None:
    """The fingers and the nickel gear are earthed; what the plate is, nobody says."""
    task = read(EXAMPLE / "task.yaml")
    plate = task.parts["shaft_plate"]
    for material, charged in ((plate.material, True), ("steel", False)):
        parts = {**task.parts, "shaft_plate": replace(plate, material=material)}
        found = release_verdict(replace(task, parts=parts), *released(task))
        sides = (found.finger, found.holding)
        most = [f.most_un for side in sides for f in side if f.name == "charge"]
        assert most[0] == 0.0
        assert (most[1] > 0) is charged


def test_a_part_off_its_shaft_hangs_by_its_weight() -> None:
    task = read(EXAMPLE / "task.yaml")
    states, high = lifted(task, 400.0)
    found = release_verdict(task, states, high)
    assert found.verdict == "may stick"
    assert found.holding == ()
    assert found.hold_un == found.weight_un
    assert "nothing within" in found.reason
    assert "shaft" not in found.reason
    # 0.3 of what a finger pulls; a thousand times heavier, it falls
    assert found.pull_un == pytest.approx([0.3 * x for x in total(found.finger)])
    gear = replace(task.parts["gear"], thickness_um=1e5)
    heavy = replace(task, parts={**task.parts, "gear": gear})
    assert release_verdict(heavy, states, high).verdict == "stays"


def test_in_a_liquid_no_release_is_judged(tmp_path: Path) -> None:
    file = copy_example(tmp_path / "task")
    change(file.parent / "workcell.yaml", "medium_index: 1.0 ", "medium_index: 1.33 ")
    task = read(file)
    found = release_verdict(task, *released(task))
    assert found.verdict == "may stick"
    assert "double layers" in found.reason
    text = file.read_text(encoding="utf-8")
    start, end = text.index("  - {id: lift,"), text.index("  - {id: release,")
    file.write_text(text[:start] + text[end:], encoding="utf-8")
    change(file, "friction: 0.3", "friction: 0")
    task = read(file)
    states, here = released(task)
    found = release_verdict(task, states, here)
    assert found.verdict == "may stick"
    assert "double layers" in found.reason
    capillary = next(f for f in found.finger if f.name == "capillary")
    assert capillary.most_un == 0.0


def test_the_ladder_leaves_out_what_would_touch() -> None:
    task = read(EXAMPLE / "task.yaml")
    states, here = released(task)
    actions = [rung.action for rung in release_verdict(task, states, here).ladder]
    assert "open to 200 um, look" in actions
    post = here.after.parts["shaft_plate"]
    beside = replace(post, pose=Pose(x_um=-202.0, y_um=0.0))  # 15 um clear
    parts = {**here.after.parts, "shaft_plate": beside}
    close = replace(here, after=replace(here.after, parts=parts))
    states = tuple(close if state is here else state for state in states)
    tight = [rung.action for rung in release_verdict(task, states, close).ladder]
    assert [a for a in actions if a not in tight] == ["open to 200 um, look"]


def test_a_part_on_the_open_stage_may_stick(tmp_path: Path) -> None:
    file = copy_example(tmp_path / "task")
    text = file.read_text(encoding="utf-8")
    start, end = text.index("  - {id: lift,"), text.index("  - {id: release,")
    file.write_text(text[:start] + text[end:], encoding="utf-8")
    task = read(file)
    states, here = released(task)
    found = release_verdict(task, states, here)
    assert found.verdict == "may stick"
    assert "uN" in found.reason
    report = Report()
    report_handling(here, None, found, report)
    assert [(d.code, d.severity) for d in report.found] == [("MP613", "note")]


def test_without_friction_it_follows_the_finger(tmp_path: Path) -> None:
    file = copy_example(tmp_path / "task")
    text = file.read_text(encoding="utf-8")
    start, end = text.index("  - {id: lift,"), text.index("  - {id: release,")
    file.write_text(text[:start] + text[end:], encoding="utf-8")
    change(file, "friction: 0.3", "friction: 0")
    task = read(file)
    states, here = released(task)
    _, grasp, release = verdicts_of(task, states, here)
    assert release is not None
    assert release.verdict == "will stick"
    report = Report()
    report_handling(here, grasp, release, report)
    assert [(d.code, d.severity) for d in report.found] == [("MP613", "infeasible")]


def test_only_steps_that_need_it_have_it_worked_out() -> None:
    task = read(EXAMPLE / "task.yaml")
    states = unfold(task, Report())
    found = {s.step.verb: verdicts_of(task, states, s) for s in states}
    for verb, (fit, grasp, release) in found.items():
        assert (fit is not None) is (verb == "insert")
        assert (grasp is not None) is (verb == "grasp")
        assert (release is not None) is (verb == "release")
