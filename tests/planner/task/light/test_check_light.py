"""What a kind of light needs and what its coherence may be, at their lines."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from microplan.optics.coherence.degree import Coherence
from microplan.planner.source.diagnostics import Diagnostic, Report
from microplan.planner.task.read_task import load_task
from microplan.planner.task.task import Task

EXAMPLE = Path(__file__).parents[4] / "examples" / "gear_on_shaft"
COAXIAL = "light: {kind: coaxial,"
STATED = "  coherence: incoherent "
RING = "light: {kind: ring, elevation_deg: [20, 45],"
BELOW = "light: {kind: transmitted, aperture: 0.3,"
ROUND = "finish: 0.3, edge_radius_um: 1"


def loaded(
    folder: Path, cell: dict[str, str], task: dict[str, str] | None = None
) -> tuple[Task | None, list[Diagnostic]]:
    """Return the example with some text replaced, and what is reported of it."""
    for name in (
        "parts/gear18.dxf",
        "parts/shaft_plate.dxf",
        "parts/tweezer_fingers.dxf",
    ):
        (folder / "parts").mkdir(exist_ok=True)
        (folder / name).write_bytes((EXAMPLE / name).read_bytes())
    for name, changes in (("workcell.yaml", cell), ("task.yaml", task or {})):
        text = (EXAMPLE / name).read_text(encoding="utf-8")
        for old, new in changes.items():
            assert old in text, old
            text = text.replace(old, new, 1)
        (folder / name).write_text(text, encoding="utf-8")
    report = Report()
    return load_task(folder / "task.yaml", report), list(report.found)


def lacks(found: list[Diagnostic]) -> set[str]:
    """Return what MP119 asks for, with the line's first word."""
    return {
        f"{d.where.text.split(':')[0].strip()}: {d.message.split('needs ')[1]}"
        for d in found
        if d.code == "MP119"
    }


def test_light_from_below_needs_its_lamp_and_the_stage(tmp_path: Path) -> None:
    kind = {COAXIAL: "light: {kind: transmitted,"}
    task, found = loaded(tmp_path, kind)
    assert task is None
    assert lacks(found) == {
        "light: aperture of the lamp", "stage: transmittance of the stage",
    }  # fmt: skip
    clear = {"reflectance: 0.10 ": "reflectance: 0.10\n    transmittance: 0.9 "}
    task, found = loaded(tmp_path, {COAXIAL: BELOW, **clear})
    assert task is not None
    assert (task.workcell.light.aperture, task.workcell.stage.transmittance) == (
        0.3, 0.9,
    )  # fmt: skip
    assert task.parts["gear"].surface.transmittance == 0


@pytest.mark.parametrize("kind", ["ring", "dark_field"])
def test_a_ring_needs_elevations_and_the_edges_and_finish_of_all_bodies(
    tmp_path: Path, kind: str
) -> None:
    task, found = loaded(tmp_path, {COAXIAL: f"light: {{kind: {kind},"})
    assert task is None
    bodies = {"gear": "gear", "shaft_plate": "shaft_plate", "tweezers": "tweezers",
              "post": "shaft_plate.post"}  # fmt: skip
    expected = {f"{line}: {key} of {name}" for line, name in bodies.items()
                for key in ("finish", "edge_radius_um")}  # fmt: skip
    assert lacks(found) == expected | {
        "light: elevation_deg of the lamp", "stage: finish of the stage",
    }  # fmt: skip


def ringed(**edges: str) -> tuple[dict[str, str], dict[str, str]]:
    """Return the changes that give all bodies what a ring needs."""
    cell = {
        COAXIAL: RING,
        "reflectance: 0.10 ": "reflectance: 0.10\n    finish: 0.2 ",
        "    reflectance: 0.70": f"    reflectance: 0.70\n    {ROUND}".replace(
            ", ", "\n    "
        ),
    }
    gear = edges.get("gear", ROUND)
    task = {
        "reflectance: 0.80": f"reflectance: 0.80\n    {gear}".replace(", ", "\n    "),
        "reflectance: 0.15": f"reflectance: 0.15\n    {ROUND}".replace(", ", "\n    "),
        "reflectance: 0.75,": f"reflectance: 0.75, {ROUND},",
    }
    return cell, task


def test_a_ring_with_all_its_numbers_is_read(tmp_path: Path) -> None:
    task, _ = loaded(tmp_path, *ringed())
    assert task is not None
    assert task.workcell.light.elevation_rad == pytest.approx(
        (math.radians(20), math.radians(45))
    )
    assert task.parts["gear"].surface.edge_radius_um == 1


def test_a_rounding_without_room_is_refused(tmp_path: Path) -> None:
    task, found = loaded(tmp_path, *ringed(gear="finish: 0.3, edge_radius_um: 15"))
    assert task is None
    assert [d.code for d in found if d.severity == "error"] == ["MP116"]


@pytest.mark.parametrize(
    ("light", "code"),
    [
        ("light: {kind: ring, elevation_deg: [20, 80],", "MP116"),  # into the cone
        ("light: {kind: ring, elevation_deg: [45, 20],", "MP113"),
        ("light: {kind: transmitted, aperture: 1.2,", "MP116"),
        ("light: {kind: coaxial, aperture: 0.3,", "MP109"),
        ("light: {kind: transmitted, aperture: 0.3, elevation_deg: [1, 2],", "MP109"),
    ],
)
def test_lamps_that_cannot_be_are_refused_at_their_line(
    tmp_path: Path, light: str, code: str
) -> None:
    task, found = loaded(tmp_path, {COAXIAL: light})
    assert task is None
    assert code in {d.code for d in found if d.where.text.startswith("light:")}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("incoherent", None),
        ("0.5", Coherence(least=0.5, most=0.5)),
        ("1.9", Coherence(least=1.9, most=1.9)),
        ("[0.3, 0.9]", Coherence(least=0.3, most=0.9)),
    ],
)
def test_a_coherence_is_a_word_a_number_or_an_interval(
    tmp_path: Path, text: str, expected: Coherence | None
) -> None:
    task, _ = loaded(tmp_path, {STATED: f"  coherence: {text} "})
    assert task is not None
    assert task.workcell.optics.coherence == expected


def test_an_unstated_coherence_is_what_the_light_allows(tmp_path: Path) -> None:
    task, _ = loaded(tmp_path, {STATED: "  # "})
    assert task is not None
    assert task.workcell.optics.coherence == Coherence(least=0, most=1, is_stated=False)
    clear = {"reflectance: 0.10 ": "reflectance: 0.10\n    transmittance: 0.9 "}
    below, _ = loaded(tmp_path, {STATED: "  # ", COAXIAL: BELOW, **clear})
    assert below is not None
    lamp = below.workcell.optics.coherence
    assert lamp is not None
    assert (lamp.least, lamp.most) == pytest.approx((0.3 / 0.42, 0.3 / 0.42))


def test_the_old_zero_is_incoherent_and_a_new_one_is_refused(tmp_path: Path) -> None:
    task, found = loaded(tmp_path, {STATED: "  coherence: 0 "})
    assert task is not None
    assert task.workcell.optics.coherence is None
    assert [(d.code, d.severity) for d in found] == [("MP120", "note")]
    newest = {"microplan_workcell: 1": "microplan_workcell: 2"}
    task, found = loaded(tmp_path, {STATED: "  coherence: 0 ", **newest})
    assert task is None
    assert [(d.code, d.severity) for d in found] == [("MP120", "error")]


@pytest.mark.parametrize("text", ["[0, 0.5]", "[0.5, 0.2]", "4.5", "-1", "coherent"])
def test_other_coherences_are_refused(tmp_path: Path, text: str) -> None:
    task, found = loaded(tmp_path, {STATED: f"  coherence: {text} "})
    assert task is None
    assert all("coherence" in d.where.text for d in found)
