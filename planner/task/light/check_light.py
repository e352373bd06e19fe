"""Checks of the light: numbers that its kind needs, values that no lamp can have."""

from __future__ import annotations

import math
from collections.abc import Iterator

from microplan.planner.source.diagnostics import Report
from microplan.planner.source.schema import Checked
from microplan.planner.source.source import Key
from microplan.planner.task.check_workcell import report_backwards
from microplan.planner.task.light.read_light import INCOHERENT
from microplan.planner.task.workcell import RINGS

_NEEDS = {"transmitted": ("aperture",), **dict.fromkeys(RINGS, ("elevation_deg",))}
_OF_STAGE = {"transmitted": "transmittance", **dict.fromkeys(RINGS, "finish")}
_EXAMPLE = {
    "aperture": "the lamp's: 0.3",
    "elevation_deg": "of the light above the horizontal: [20, 40]",
    "transmittance": "the share that it lets through: 0.9",
    "finish": "the share that it mirrors: 0.2, or [0, 0.5]",
    "edge_radius_um": "of its rounded edges: 1",
}


def check_light(task: Checked, cell: Checked, report: Report) -> None:
    """Report what the light of a workcell lacks, there and in the task's bodies."""
    _check_coherence(cell, report)
    if not (cell.good("light") and cell.good("optics")):
        return
    kind = cell.source.get("light", "kind") or "coaxial"
    needed = _NEEDS.get(kind, ())
    for key in ("aperture", "elevation_deg"):
        given = cell.source.get("light", key) is not None
        if given and key not in needed:
            message = f"key '{key}' means nothing in light of kind {kind}"
            report.error("MP109", cell.source.key("light", key), message, "remove it")
        elif not given and key in needed:
            _report_lack(cell, ("light", "kind"), key, kind, "the lamp", report)
    if kind in _OF_STAGE and cell.good("axes", "stage"):
        key = _OF_STAGE[kind]
        if cell.source.get("axes", "stage", key) is None:
            _report_lack(cell, ("axes", "stage"), key, kind, "the stage", report)
    _check_lamp(cell, kind, report)
    if kind in RINGS:
        _check_bodies(cell, _tools(cell), kind, report)
        _check_bodies(task, _parts(task), kind, report)


def _check_coherence(cell: Checked, report: Report) -> None:
    """Report a coherence of 0, or one that runs backwards or is no word of it."""
    where = ("optics", "coherence")
    value = cell.source.get(*where)
    if not cell.good(*where) or value is None:
        return
    at = cell.source.value(*where)
    if isinstance(value, list):
        report_backwards(cell.source, where, value[0], value[1], report)
    elif value == 0 and cell.source.get("microplan_workcell") == 1:
        message = "coherence 0 is read as incoherent light, as version 1 meant it"
        report.note("MP120", at, message, f"write coherence: {INCOHERENT}")
    elif value == 0:
        message = "coherence 0 would be a lamp without extent, got 0"
        hint = f"write {INCOHERENT}, the condenser's aperture over the objective's, or "
        report.error("MP120", at, message, hint + "leave it out if it is not known")


def _check_lamp(cell: Checked, kind: str, report: Report) -> None:
    """Report apertures and elevations that no such lamp can have."""
    index = cell.source.get("optics", "medium_index") or 1.0
    aperture = cell.source.get("light", "aperture")
    if kind == "transmitted" and aperture is not None and aperture >= index:
        at = cell.source.value("light", "aperture")
        message = f"the lamp's aperture {aperture} is not below medium_index {index}"
        report.error("MP116", at, message, "an aperture is the index times a sine")
    elevation = cell.source.get("light", "elevation_deg")
    if kind not in RINGS or elevation is None:
        return
    at = cell.source.value("light", "elevation_deg")
    low, high = elevation
    if low >= high:
        message = f"light.elevation_deg must rise, got {low} to {high}"
        report.error("MP113", at, message, "state the ring's least and most")
        return
    table = cell.source.get("optics", "numerical_aperture")
    rows = [r["value"] for r in table] if isinstance(table, list) else [table]
    rim_deg = math.degrees(math.acos(min(max(rows) / index, 1.0)))
    if high > rim_deg:
        message = f"the ring reaches {high} deg, into the objective's cone above "
        message += f"{rim_deg:.1f} deg"
        hint = "what is mirrored of such light is bright field: state the part below"
        report.error("MP116", at, message, hint)


def _check_bodies(
    file: Checked, bodies: Iterator[tuple[tuple[Key, ...], str]], kind: str,
    report: Report,
) -> None:  # fmt: skip
    """Report bodies without what a ring's light shows of them."""
    for where, name in bodies:
        if not file.good(*where):
            continue
        for key in ("finish",) if "marks" in where else ("finish", "edge_radius_um"):
            if file.source.get(*where, key) is None:
                _report_lack(file, where, key, kind, name, report)


def _report_lack(
    file: Checked, where: tuple[Key, ...], key: str, kind: str, name: str,
    report: Report,
) -> None:  # fmt: skip
    """Report a number that is missing at the line of what lacks it."""
    stated = file.source.get(*where) is not None
    at = file.source.key(*where) if stated else file.source.key(*where[:-1])
    message = f"light of kind {kind} needs {key} of {name}"
    report.error("MP119", at, message, f"{key}: {_EXAMPLE[key]}")


def _tools(cell: Checked) -> Iterator[tuple[tuple[Key, ...], str]]:
    for name in sorted(cell.source.mapping("tools")):
        yield ("tools", name), name


def _parts(task: Checked) -> Iterator[tuple[tuple[Key, ...], str]]:
    """Yield parts, posts and marks with their names."""
    for part in sorted(task.source.mapping("parts")):
        yield ("parts", part), part
        for mark in sorted(task.source.mapping("parts", part, "marks")):
            yield ("parts", part, "marks", mark), f"{part}.{mark}"
        for post in sorted(task.source.mapping("parts", part, "posts")):
            where = ("parts", part, "posts", post)
            yield where, f"{part}.{post}"
            for mark in sorted(task.source.mapping(*where, "marks")):
                yield (*where, "marks", mark), f"{part}.{post}.{mark}"
