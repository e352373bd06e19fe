"""What a task says and nothing acts on is never passed over in silence."""

from __future__ import annotations

from pathlib import Path

import pytest

from microplan.planner.assembly.step_states import unfold
from microplan.planner.source.diagnostics import Diagnostic, Report
from tests.planner.examples import EXAMPLE, change, copy_example, read

LIFT = "{id: lift,            do: move,    move"
INSERT = "onto: shaft_plate.post, move: [{stage: {z_um: 0}}]"
BLOCKED = "if_blocked: {back_um: 20, search: spiral, pitch_um: 4, radius_um: 8}"


def idle(file: Path) -> list[Diagnostic]:
    """Return what is said of keys without effect."""
    report = Report()
    unfold(read(file), report)
    return [finding for finding in report.in_order if finding.code == "MP307"]


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("target: gear.bore}", "target: gear.bore, view_um: [0, 0]}", "on the robot"),
        ("target: tweezers, move", "target: tweezers, view_um: [0, 0], move",
         "on the robot"),
        (LIFT, f"{LIFT[:-4]}view_um: [0, 0], move", "no target"),
        (INSERT, f"{INSERT}, view_um: [0, 0]", "undo the alignment"),
    ],
    ids=["held", "tool", "no target", "insert"],
)  # fmt: skip
def test_a_view_that_moves_nothing_is_a_warning(
    tmp_path: Path, old: str, new: str, why: str
) -> None:
    file = copy_example(tmp_path / "task")
    change(file, old, new)
    finding = next(d for d in idle(file) if "'view_um'" in d.message)
    assert finding.severity == "warning"
    assert why in finding.message
    assert finding.hint
    assert finding.where.text[finding.where.column - 1 :].startswith("[0, 0]")


def test_a_search_that_is_not_made_is_a_note(tmp_path: Path) -> None:
    assert idle(EXAMPLE / "task.yaml") == []  # and its views all move the stage
    file = copy_example(tmp_path / "task")
    change(file, "speed_um_per_s: 20}", f"speed_um_per_s: 20, {BLOCKED}}}")
    (finding,) = idle(file)
    assert (finding.severity, "'if_blocked'" in finding.message) == ("note", True)


def test_a_part_face_down_is_refused_not_planned_face_up(tmp_path: Path) -> None:
    file = copy_example(tmp_path / "task")
    change(file, "face: up", "face: down")
    (finding,) = idle(file)
    assert finding.severity == "infeasible"
    assert "gear" in finding.message
