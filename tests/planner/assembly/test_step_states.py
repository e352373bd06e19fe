"""The example's thirteen steps: who holds what, where, and by which path."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

from microplan.planner.assembly.assembly import (
    State,
    bodies,
    grip_sigma_um,
    locate_place,
    part_pose,
    part_sigma_um,
    part_z_um,
)
from microplan.planner.assembly.step_states import StepState, unfold
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.task import Task
from tests.planner.examples import (
    EXAMPLE,
    beyond_notes,
    change,
    copy_example,
    down_the_bore,
    look_down_the_bore,
    read,
)


@cache
def example() -> tuple[Task, dict[str, StepState]]:
    """Return the example and its steps' states by id."""
    task, report = read(EXAMPLE / "task.yaml"), Report()
    states = unfold(task, report)
    assert beyond_notes(report) == []
    return task, {s.step.id: s for s in states}


def after(step: str) -> tuple[Task, State]:
    task, states = example()
    return task, states[step].after


def place(step: str, name: str) -> tuple[float, float, float]:
    """Return the nominal world place of a name's face after a step."""
    found = locate_place(*after(step), name)
    return found.pose.x_um, found.pose.y_um, found.z_um


def test_all_thirteen_steps_follow_each_other() -> None:
    task, states = example()
    assert list(states) == [step.id for step in task.steps]
    assert len(states) == 13
    ordered = list(states.values())
    for before, here in pairwise(ordered):
        assert here.before is before.after


WIDTH_UM = 100 * math.cos(math.radians(6))  # of the gear, on two tips either side
# after each step: the gear's place and underside, the post's face, the jaws, who holds
TABLE = [
    ("find_gear", (0, 0, 0), (-600, 0, 250), 130, None),
    ("see_fingers", (0, -250, 0), (-600, -250, 250), 130, None),
    ("bring_between", (0, 0, 0), (-600, 0, 250), 130, None),
    ("grasp", (0, 0, 0), (-600, 0, 250), WIDTH_UM, "gear"),
    ("lift", (0, 0, 0), (-600, 0, -10), WIDTH_UM, "gear"),
    ("gear_in_fingers", (0, 0, 0), (-600, 0, -10), WIDTH_UM, "gear"),
    ("aside", (0, 400, 0), (-600, 0, -10), WIDTH_UM, "gear"),
    ("find_shaft", (0, 400, 0), (0, 0, -10), WIDTH_UM, "gear"),
    ("over_shaft", (0, 0, 0), (0, 0, -10), WIDTH_UM, "gear"),
    ("insert", (0, 0, 0), (0, 0, 250), WIDTH_UM, "gear"),
    ("release", (0, 0, 0), (0, 0, 250), 130, None),
    ("retract", (0, 0, 0), (0, 0, 250), 130, None),
    ("check_seated", (0, 0, 0), (0, 0, 250), 130, None),
]


@pytest.mark.parametrize(
    ("step", "gear", "post", "opening_um", "held"), TABLE, ids=[row[0] for row in TABLE]
)
def test_everything_is_where_the_task_puts_it(
    step: str,
    gear: tuple[float, float, float],
    post: tuple[float, float, float],
    opening_um: float,
    held: str | None,
) -> None:
    task, state = after(step)
    pose = part_pose(task, state, "gear")
    found = (pose.x_um, pose.y_um, part_z_um(task, state, "gear"))
    assert found == pytest.approx(gear, abs=1e-9)
    assert place(step, "shaft_plate.post") == pytest.approx(post, abs=1e-9)
    assert state.opening_um == pytest.approx(opening_um, abs=0.01)  # chords of arcs
    assert state.held == held
    carrier = "robot" if held else "stage"
    assert state.parts["gear"].carrier == carrier
    assert state.parts["shaft_plate"].carrier == "stage"


def test_the_gear_keeps_its_height_relative_to_the_tool() -> None:
    _, state = after("lift")
    assert state.parts["gear"].z_um == -40  # the jaws hold it 40 um above its underside
    assert state.robot.z_um == 40


def test_the_gear_ends_on_the_plate_around_the_post() -> None:
    task, state = after("check_seated")
    named = {b.name: b for b in bodies(task, state)}
    assert named["gear"].z_low_um == named["shaft_plate"].z_high_um == 0
    assert named["shaft_plate.post"].z_high_um == 250
    assert named["tweezers.left"].z_low_um == 400


def test_the_gear_slides_in_between_the_fingers_x_first() -> None:
    _, states = example()
    assert states["bring_between"].path == ("x", "y")
    assert states["over_shaft"].path == ("xy",)
    paths = {name: s.path for name, s in states.items() if s.path}
    assert set(paths) == {"bring_between", "over_shaft"}


def test_a_view_moves_the_stage_before_the_look() -> None:
    _, states = example()
    (move,) = states["find_shaft"].moves
    assert (move.axes, move.to.x_um, move.to.y_um) == ("stage", 0.0, 0.0)
    assert states["find_gear"].moves == ()  # the gear is there already
    assert [m.axes for m in states["see_fingers"].moves] == ["stage", "robot", "robot"]
    assert states["insert"].moves == ()  # an insertion's moves are its action
    assert states["insert"].after.stage.z_um == 0


def test_the_servo_leaves_the_spread_of_goal_and_stage() -> None:
    _, states = example()
    aligned = states["bring_between"].at_look
    robot, stage = 0.4, 1.0
    assert part_sigma_um(aligned, "gear") == pytest.approx(math.hypot(robot, stage))
    _, first = after("find_gear")
    assert part_sigma_um(first, "gear") == pytest.approx(math.hypot(30, stage))


def test_a_turn_swings_the_grip_until_a_look_sees_it(tmp_path: Path) -> None:
    file = copy_example(tmp_path / "task")
    swung_um = math.hypot(0.4, 20800 * math.radians(23.56 / 3600))
    states = {s.step.id: s for s in unfold(read(file), Report())}
    assert states["see_fingers"].at_look.tip_sigma_um == pytest.approx(swung_um)
    assert states["see_fingers"].after.tip_sigma_um == pytest.approx(0.4)
    assert states["insert"].before.tip_sigma_um == pytest.approx(0.4)
    change(file, "[{stage: {z_um: -260}}]",
           "[{stage: {z_um: -260}}, {robot: {theta_deg: 0.5}}]")  # fmt: skip
    states = {s.step.id: s for s in unfold(read(file), Report())}
    assert states["lift"].after.tip_sigma_um == pytest.approx(swung_um)
    assert states["gear_in_fingers"].after.tip_sigma_um == pytest.approx(0.4)


def test_a_move_of_the_stage_undoes_what_the_servo_pinned() -> None:
    states = {s.step.id: s for s in unfold(read(down_the_bore()), Report())}
    seen = states["find_shaft"].at_look
    assert seen.pinned == {}
    assert part_sigma_um(seen, "shaft_plate") == pytest.approx(math.hypot(10, 1))
    lifted = states["insert"].after  # z alone keeps the pin
    assert part_sigma_um(lifted, "shaft_plate") < 2


def test_a_robot_follows_its_goal_to_where_that_is() -> None:
    """The plate is 10 um off, not off the gear that was brought over its post."""
    _, states = example()
    robot, plate = 0.4, math.hypot(10, 1)
    aligned = states["over_shaft"].at_look
    gear = part_sigma_um(aligned, "gear")
    assert gear < 2
    assert part_sigma_um(aligned, "shaft_plate") == pytest.approx(
        math.hypot(gear, robot)
    )
    seated = states[
        "check_seated"
    ].at_look  # the robot is gone, the stage has not moved
    assert part_sigma_um(seated, "shaft_plate") == part_sigma_um(aligned, "shaft_plate")
    for name in ("gear", "shaft_plate.post"):  # the camera sees both as far off
        there = locate_place(read(EXAMPLE / "task.yaml"), seated, name)
        assert there.frame_sigma_um == pytest.approx(
            math.hypot(plate, part_sigma_um(seated, there.owner))
        )
    assert grip_sigma_um(seated) == pytest.approx(math.hypot(robot, plate))


def test_a_robot_that_is_aligned_again_has_followed_no_less(tmp_path: Path) -> None:
    file = copy_example(tmp_path / "task")
    again = "align, target: gear.bore, to: shaft_plate.post, method: auto}"
    change(file, "  - {id: insert,", f"  - {{id: again, do: {again}\n  - {{id: insert,")
    states = {s.step.id: s for s in unfold(read(file), Report())}
    first, then = (states[name].at_look for name in ("over_shaft", "again"))
    assert then.followed_um >= first.followed_um > 10
    assert part_sigma_um(then, "shaft_plate") == pytest.approx(
        part_sigma_um(first, "shaft_plate")
    )
    assert then.stage_sigma_um == pytest.approx(first.stage_sigma_um)  # of other parts


def test_a_robot_that_left_what_it_followed_is_as_far_off_until_it_is_back(
    tmp_path: Path,
) -> None:
    """Whatever it turns, and whatever looks at it."""
    file = copy_example(tmp_path / "task")
    there = "{robot: {z_um: 400}}, {robot: {y_um: 3000}}"
    change(file, there, f"{there}, {{robot: {{theta_deg: 2}}}}")
    states = {s.step.id: s for s in unfold(read(file), Report())}
    gone = states["retract"].after
    plate = math.hypot(10, 1)
    assert gone.strayed_um == pytest.approx(plate)
    assert grip_sigma_um(gone) == pytest.approx(math.hypot(gone.tip_sigma_um, plate))
    assert grip_sigma_um(states["insert"].after) < 1  # it is there


def test_a_part_beside_the_goal_is_farther_off_than_the_goal(tmp_path: Path) -> None:
    """A robot follows its goal by 10 um, and may meet what lies beside it."""
    part = (
        "spare: {drawing: {file: parts/gear18.dxf, units: um, layers: [OUTLINE]}, "
        "thickness_um: 320, reflectance: 0.8, material: nickel}"
    )
    for gap, refused in ((8, True), (60, False)):
        file = copy_example(tmp_path / f"{gap}")
        start = f"spare: {{on: stage, x_um: 0, y_um: {-100 - gap}, sigma_xy_um: 0.1}}"
        change(file, "parts:  ", f"parts:\n  {part}\n#")
        change(file, "start:  ", f"start:\n  {start}\n#")
        report = Report()
        unfold(read(file), report)
        hits = [f.message for f in report.in_order if f.code == "MP303"]
        assert any("over_shaft" in hit for hit in hits) is refused
        assert bool(hits) is refused


def test_a_move_of_the_stage_errs_beside_what_the_robot_followed(
    tmp_path: Path,
) -> None:
    _, before = example()
    file = copy_example(tmp_path / "task")
    change(file, "{robot: {z_um: 400}}, ", "{robot: {z_um: 400}}, {stage: {y_um: 9}}, ")
    left = {s.step.id: s for s in unfold(read(file), Report())}["retract"].after
    for name in ("gear", "shaft_plate"):
        still = part_sigma_um(before["retract"].after, name)
        assert part_sigma_um(left, name) == pytest.approx(
            math.hypot(still, math.sqrt(2))
        )
    assert left.followed_um == before["retract"].after.followed_um > 10


def test_a_turn_of_the_stage_ends_what_the_robot_followed(tmp_path: Path) -> None:
    file = copy_example(tmp_path / "task")
    change(
        file,
        "{robot: {z_um: 400}}, ",
        "{robot: {z_um: 400}}, {stage: {theta_deg: 1}}, ",
    )
    left = {s.step.id: s for s in unfold(read(file), Report())}["retract"].after
    assert (left.pinned, left.followed_um) == ({}, 0.0)
    plate = math.hypot(10, 1)
    assert part_sigma_um(left, "shaft_plate") == pytest.approx(plate)
    assert part_sigma_um(left, "gear") > plate  # it was put down where the post is


def test_changing_hands_forgets_where_a_part_is() -> None:
    _, states = example()
    assert "gear" in states["bring_between"].after.located
    assert "gear" not in states["grasp"].after.located
    assert "tweezers" in states["grasp"].after.located
    assert "gear.bore" in states["over_shaft"].after.located


def test_a_grasp_centres_the_part_and_turns_it_flat(tmp_path: Path) -> None:
    file = copy_example(tmp_path / "task")
    change(file, "x_um: 600, y_um: 0, theta: any", "x_um: 600, y_um: 0, theta_deg: 7")
    task, report = read(file), Report()
    grasp = next(s for s in unfold(task, report) if s.step.verb == "grasp")
    assert beyond_notes(report) == []
    held = grasp.after.parts["gear"]
    # 18 teeth: the hull's edges, and so its flat positions, lie 10 degrees off a tooth
    assert held.pose.theta_rad == pytest.approx(math.radians(10), abs=1e-9)
    assert held.pose.x_um == 0
    # the angle was known: it always ends in that flat, as true as the robot turns
    robot_rad = task.workcell.robot.axes.repeatability_theta_rad
    assert held.sigma_theta_rad == pytest.approx(robot_rad)


@pytest.mark.parametrize(
    ("file", "old", "new", "code", "step"),
    [
        # the robot comes down on the gear, which is at the grip already
        ("task.yaml", "{stage: {y_um: -250}}, ", "", "MP303", "see_fingers"),
        # jaws that start too close leave no way in
        ("task.yaml", "z_um: 400, opening_um: 130", "z_um: 400, opening_um: 102",
         "MP303", "bring_between"),
        # the stage goes up while the fingers hold the gear on it
        ("task.yaml", "{stage: {z_um: -260}}", "{stage: {z_um: 10}}", "MP303", "lift"),
        # the fingers go aside while they still stand around the gear
        ("task.yaml", "move: [{robot: {z_um: 400}}, {robot: {y_um: 3000}}]",
         "move: [{robot: {x_um: 500}}]", "MP303", "retract"),
        # jaws that do not close on the gear
        ("task.yaml", "tweezers, opening_um: 96", "tweezers, opening_um: 101",
         "MP304", "grasp"),
    ],
    ids=["down on the gear", "jaws too close", "stage up", "aside", "loose"],
)  # fmt: skip
def test_motion_that_touches_something_is_refused(
    tmp_path: Path, file: str, old: str, new: str, code: str, step: str
) -> None:
    task_file = copy_example(tmp_path / "task")
    change(task_file.with_name(file), old, new)
    report = Report()
    unfold(read(task_file), report)
    first = beyond_notes(report)[0]
    assert (first.code, first.severity) == (code, "infeasible")
    assert repr(step) in first.message
    assert first.where.line > 0


def test_a_part_that_is_still_held_is_said_to_be_in_the_way(tmp_path: Path) -> None:
    file = copy_example(tmp_path / "task")
    lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
    kept = [line for line in lines if "id: release," not in line]
    assert len(kept) == len(lines) - 1
    file.write_text("".join(kept), encoding="utf-8")
    report = Report()
    unfold(read(file), report)
    found = next(d for d in report.found if d.code == "MP303")
    assert found.message.startswith("step 'retract': gear would touch shaft_plate.post")
    assert found.hint.startswith("the tool still holds gear: release it before")


def test_a_wide_start_needs_x_first_and_a_narrow_one_does_not(tmp_path: Path) -> None:
    """At 30 um the gear may start beside the opening; at 2 um it goes in straight."""
    file = copy_example(tmp_path / "task")
    change(file, "theta: any, sigma_xy_um: 30", "theta: any, sigma_xy_um: 2")
    report = Report()
    states = unfold(read(file), report)
    align = next(s for s in states if s.step.id == "bring_between")
    assert beyond_notes(report) == []
    assert align.path == ("xy",)


def test_every_path_blocked_is_refused_and_says_so(tmp_path: Path) -> None:
    file = copy_example(tmp_path / "task")
    change(file, "{robot: {z_um: 40}}]}", "{robot: {z_um: 40}}, {stage: {y_um: 180}}]}")
    report = Report()
    unfold(read(file), report)
    assert {d.code for d in beyond_notes(report)} == {"MP303"}


def test_the_way_out_of_an_approach_fits_what_would_touch(tmp_path: Path) -> None:
    """Fingers can be opened further; a gear in the way of a post cannot."""
    jaws, lift = (copy_example(tmp_path / name) for name in ("jaws", "lift"))
    change(jaws, "z_um: 400, opening_um: 130", "z_um: 400, opening_um: 102")
    change(lift, "{stage: {z_um: -260}}", "{stage: {z_um: -200}}")
    hints = []
    look_down_the_bore(lift)
    for file, step in ((jaws, "bring_between"), (lift, "over_shaft")):
        report = Report()
        unfold(read(file), report)
        hints += [d.hint for d in report.found
                  if d.code == "MP303" and repr(step) in d.message]  # fmt: skip
    of_jaws, of_gear = hints
    assert "jaws" in of_jaws
    assert "jaws" not in of_gear
    assert "z" in of_gear.split()


def test_parts_that_move_together_come_with_a_way_out(tmp_path: Path) -> None:
    file = copy_example(tmp_path / "task")
    change(file, "  - {id: grasp, ", "  # {id: grasp, ")
    report = Report()
    unfold(read(file), report)
    (finding,) = [d for d in report.found if d.code == "MP301"]
    assert "move together" in finding.message
    assert "grasp" in finding.hint
