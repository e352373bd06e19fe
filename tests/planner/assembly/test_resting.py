"""Grasps and placements judged by what parts cover, not by where their origins are."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import pytest

from microplan.optics.outline.outline import Outline, Ring, Segment, place
from microplan.planner.assembly.assembly import PartState, State, part_pose, with_part
from microplan.planner.assembly.holding import between_jaws, grasp, release
from microplan.planner.assembly.initial_state import initial
from microplan.planner.assembly.resting import resting
from microplan.planner.assembly.step_states import unfold
from microplan.planner.source.diagnostics import Diagnostic, Report
from microplan.planner.task.read_task import load_task
from microplan.planner.task.task import Move, Reading, Task, TaskStep
from microplan.schemas.pose import Pose
from tests.planner.examples import ROOT, beyond_notes

DIE_UM = (250.0, 150.0)  # drawn about (0, 145)
PLATE = (-450.0, -250.0, 450.0, 450.0)
SPREAD_UM = 0.05  # of the die's place and the submount's in these tests
FIRST = ROOT / "examples" / "laser_die" / "task.yaml"


@pytest.fixture(scope="module")
def task() -> Task:
    report = Report()
    found = load_task(FIRST, report)
    assert found is not None, report.found
    return found


def step_of(task: Task, name: str) -> TaskStep:
    return next(step for step in task.steps if step.id == name)


def lying(task: Task, x_um: float, y_um: float, gap_um: float = 0.0) -> State:
    """Return a state with the die's middle at a place of the submount, on it."""
    start = initial(task)
    held = PartState(
        carrier="robot", pose=Pose(x_um=x_um, y_um=y_um - 145.0), z_um=-30.0,
        sigma_xy_um=SPREAD_UM, sigma_z_um=0.1, sigma_theta_rad=0.0,
    )  # fmt: skip
    plate = replace(
        start.parts["submount"], pose=Pose(x_um=0.0, y_um=0.0), sigma_xy_um=SPREAD_UM
    )
    state = with_part(with_part(start, "submount", plate), "die", held)
    robot = replace(state.robot, x_um=0.0, y_um=0.0, z_um=180.0 + gap_um)
    return replace(state, robot=robot, held="die", stage_sigma_um=0.0, tip_sigma_um=0.0)


def released(task: Task, state: State) -> list[Diagnostic]:
    report = Report()
    release(task, state, step_of(task, "release"), report)
    return beyond_notes(report)


def test_a_die_inside_its_submount_rests_on_all_of_it(task: Task) -> None:
    found = resting(task, lying(task, 0.0, 145.0, gap_um=2.0), "die")
    assert found.on == ("submount",)
    assert found.beyond_um == 0.0
    assert released(task, lying(task, 0.0, 145.0)) == []


@pytest.mark.parametrize("over_um", [10.0, 40.0, 80.0, 200.0])
@pytest.mark.parametrize("side", [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_what_hangs_over_is_found_by_its_extent(
    task: Task, side: tuple[int, int], over_um: float
) -> None:
    """On every side alike, though the die's origin is 145 um from its middle."""
    x, y = side
    middle = (
        x * (450.0 - DIE_UM[0] / 2 + over_um),
        100.0 + y * (350.0 - DIE_UM[1] / 2 + over_um),
    )
    state = lying(task, *middle)
    found = resting(task, state, "die")
    width_um = DIE_UM[0] if x else DIE_UM[1]
    if over_um >= width_um:  # beside it: it falls on the stage
        assert found.on == ()
        return
    assert found.beyond_um == pytest.approx(over_um, rel=1e-6)
    # its vias are round their own middles, and take nothing from one side only
    tips = over_um >= width_um / 2 - 2 * math.hypot(SPREAD_UM, SPREAD_UM)
    (told,) = released(task, state)
    assert told.code == "MP308"
    assert told.severity == ("infeasible" if tips else "warning")
    assert f"{over_um:.3g} um" in told.message


def test_a_part_on_two_plates_that_are_apart_rests_between_them(task: Task) -> None:
    start = lying(task, 0.0, 145.0)
    plate = task.parts["submount"]
    left = replace(plate, name="left", outline=place(plate.outline, -500.0, 0.0))
    right = replace(plate, name="right", outline=place(plate.outline, 500.0, 0.0))
    parts = {"die": task.parts["die"], "left": left, "right": right}
    both = dict.fromkeys(("left", "right"), start.parts["submount"])
    state = replace(start, parts={"die": start.parts["die"], **both})
    apart = replace(task, parts=parts)
    found = resting(apart, state, "die")
    assert found.on == ("left", "right")
    assert found.inside_um > 0  # a bridge; each alone would let it tip
    alone = replace(state, parts={k: v for k, v in state.parts.items() if k != "left"})
    assert resting(apart, alone, "die").inside_um <= 0


@pytest.mark.parametrize("over_um", [-20.0, 20.0])
def test_a_hole_below_carries_nothing(task: Task, over_um: float) -> None:
    """A die over the rim of a large hole tips into it once its middle is beyond."""
    state = lying(task, 0.0, 100.0)
    plate = task.parts["submount"]
    x = -over_um  # the hole begins there and ends beyond the die
    corners = [(x, -100.0), (x, 300.0), (400.0, 300.0), (400.0, -100.0)]
    sides = pairwise([*corners, corners[0]])
    hole = Ring(edges=tuple(Segment(start=a, end=b) for a, b in sides), layer="H")
    outer = max(plate.outline.rings, key=lambda ring: ring.signed_area_um2)
    pierced = replace(plate, outline=Outline(rings=(outer, hole)))
    changed = replace(task, parts={**task.parts, "submount": pierced})
    found = released(changed, state)
    assert (resting(changed, state, "die").inside_um > 0) is (over_um < 0)
    assert [d.severity for d in found] == ["infeasible"] * (over_um > 0)


def test_a_narrow_part_may_hang_over_lengthwise(task: Task) -> None:
    """What lies under its long sides reaches beyond them: they are no edges to tip."""
    state = lying(task, 450.0 - DIE_UM[0] / 2 + 40.0, 100.0)
    narrow = replace(
        task.parts["die"], outline=oblong(DIE_UM[0], 0.2)
    )  # its middle is nearer to its sides than two sigma
    changed = replace(task, parts={**task.parts, "die": narrow})
    (told,) = released(changed, state)
    assert (told.code, told.severity) == ("MP308", "warning")
    inside = resting(changed, state, "die").inside_um
    assert inside == pytest.approx(DIE_UM[0] / 2 - 40.0, rel=1e-6)


def oblong(x_um: float, y_um: float) -> Outline:
    """Return a bar about where the die is drawn."""
    a, b = x_um / 2, y_um / 2
    corners = [(-a, 145 - b), (a, 145 - b), (a, 145 + b), (-a, 145 + b)]
    sides = pairwise([*corners, corners[0]])
    edges = tuple(Segment(start=a, end=b) for a, b in sides)
    return Outline(rings=(Ring(edges=edges, layer="A"),))


@pytest.mark.parametrize(("y_um", "reaches"), [(-190.0, True), (-210.0, False)])
def test_jaws_reach_a_part_by_its_middle(
    task: Task, y_um: float, *, reaches: bool
) -> None:
    """The tips are 200 um before the grip, the die's origin 145 um before its middle.

    By its origin the first would be out of reach already.
    """
    found = grasped(task, Pose(x_um=0.0, y_um=y_um - 145.0), z_um=30.0)
    assert ("MP305" in {d.code for d in found}) is not reaches


def test_jaws_above_a_part_do_not_reach_it(task: Task) -> None:
    at = Pose(x_um=0.0, y_um=-145.0)
    assert "MP305" not in {d.code for d in grasped(task, at, z_um=99.0)}
    assert "MP305" in {d.code for d in grasped(task, at, z_um=101.0)}  # 100 um thick


def grasped(task: Task, die: Pose, z_um: float) -> list[Diagnostic]:
    """Return what is found of a grasp of the die lying at `die` on the stage."""
    start = initial(task)
    part = replace(start.parts["die"], pose=die, sigma_xy_um=0.1)
    robot = replace(start.robot, x_um=0.0, y_um=0.0, z_um=z_um)
    state = replace(with_part(start, "die", part), robot=robot)
    report = Report()
    grasp(task, state, step_of(task, "grasp"), report)
    return beyond_notes(report)


@pytest.mark.parametrize("off_um", [-30.0, 12.5])
def test_a_part_is_centred_by_what_the_jaws_touch(task: Task, off_um: float) -> None:
    """A die drawn off its origin across the jaws ends with its middle between them."""
    die = task.parts["die"]
    moved = replace(die, outline=place(die.outline, off_um, 0.0))
    changed = replace(task, parts={**task.parts, "die": moved})
    start = initial(changed)
    part = replace(start.parts["die"], pose=Pose(x_um=3.0 - off_um, y_um=-145.0))
    robot = replace(start.robot, x_um=0.0, y_um=0.0, z_um=30.0)
    state = replace(with_part(start, "die", part), robot=robot)
    step = step_of(changed, "grasp")
    stands = between_jaws(changed, state, step)
    assert stands.offset_um == pytest.approx(3.0)
    assert stands.room_um == pytest.approx((320 - DIE_UM[0]) / 2 - 3.0)
    after = grasp(changed, state, step, Report())
    assert part_pose(changed, after, "die").x_um == pytest.approx(-off_um)


@pytest.mark.parametrize(("z_um", "touches"), [(-152.0, False), (-120.0, True)])
def test_fingers_beside_the_die_are_found_on_the_submount(
    task: Task, z_um: float, *, touches: bool
) -> None:
    """Their grip is over the die; what touches is 150 um beside it."""
    steps = tuple(
        replace(step, move=(lowered(step, z_um),)) if step.id == "place" else step
        for step in task.steps
    )
    report = Report()
    unfold(replace(task, steps=steps), report)
    words = " ".join(d.message for d in report.found if d.code == "MP303")
    assert ("submount would touch tweezers.left" in words) is touches
    assert ("submount would touch tweezers.right" in words) is touches


def lowered(step: TaskStep, z_um: float) -> Move:
    return replace(step.move[0], to=Reading(z_um=z_um))
