"""A task of one look at one part, for pictures of a part that no task describes."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import yaml

from microplan.arrays import Point
from microplan.optics.outline.outline import Outline, Ring
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.drawings.drawing_findings import UM_PER_UNIT, header_unit
from microplan.planner.drawings.dxf.drawing import Drawing, take
from microplan.planner.measure.near import NearPlace
from microplan.planner.source.diagnostics import CallError, Diagnostic, Report, Span
from microplan.planner.source.schema import Checked
from microplan.planner.source.source import Source, parse
from microplan.planner.task.drawings import AnyDrawing, open_named, shape_layers
from microplan.planner.task.read_task import read_task
from microplan.planner.task.task import Task
from microplan.planner.task.workcell import Workcell
from microplan.planner.views.views import CONTEXT_UM, SEARCH_SIGMAS
from microplan.planner.views.zooms import microscope_at

Polarity = Literal["bright", "dark"]

CODE = "MP903"
_NO_FILE = "--part"  # name of a task file that there is not
STEP = "look"  # id of the task's only step
PART = "part"
# Reflectances of a bright face and a dark one: routines take gain and offset from the
# picture, the likelihood fit the offset where its gain alone does not explain it.
_BRIGHT, _DARK = 0.8, 0.1
_NEAR_PX = 4.0  # standard deviation per axis of a place that a user reads off a picture
_NEAR_DEG = 2.0  # and of an angle
# What pictures are tried with besides: focus, share of the depth of field, and scale.
_FOCUS_SHARE, _SCALE = 0.25, 0.002
_LEAST_UM, _ROUND = 0.005, 0.02  # of a disc that is a point: across, share off round
_UNITS = ("um", *(unit for unit in UM_PER_UNIT if unit != "um"))


@dataclass(frozen=True, slots=True, kw_only=True)
class PartCall:
    """A part and how pictures of it were taken; None is taken from drawing and cell."""

    part: Path  # drawing
    workcell: Path
    target: str | None = None  # "circle:LAYER", "teeth:LAYER:N", ...; the outline
    height_um: float | None = None  # of the part; 0: flat
    units: str | None = None
    layers: tuple[str, ...] | None = None
    # layers that lie on it as faces of their own: about their reflectance over its
    faces: tuple[tuple[str, float], ...] | None = None
    cell: str | None = None
    polarity: Polarity | None = None  # of the part against its surroundings; bright
    magnification: float | None = None
    near: NearPlace | None = None


def part_task(call: PartCall, report: Report) -> Task | None:
    """Return a task whose one step, `STEP`, locates a target of a part.

    The middle of the part's box lies on the stage where `near` says, else in the middle
    of the field and anywhere in it.

    Returns
    -------
    Task or None
        None if there was any error, with findings as of a task file.

    Raises
    ------
    CallError
        MP903 if something is missing that drawing and workcell leave open, or if the
        target is none.
    """
    if not 0 <= (call.height_um or 0.0) < math.inf:
        raise CallError(CODE, f"--height-um must be 0 or more, got {call.height_um}")
    opened = _opened(call, report)
    if opened is None:
        return None
    drawing, units = opened
    if call.units is None and isinstance(drawing, Drawing):
        units = _units(call, drawing)
    layers = call.layers or (_layer(call, drawing),)
    data = _data(call, units, layers)
    found = Report()
    task = read_task(_source(call, data), found)
    report.found.extend(_of_drawing(call, each) for each in found.found)
    if task is None:
        return None
    return _sought(_magnified(task, call), call)


def point_radius_um(call: PartCall, most_um: float) -> float | None:
    """Return the radius of a drawing's only disc, of at most so many um across.

    None of anything larger, which `part_task` has findings about. CallError, MP903, if
    all rings are so small but are not one disc.
    """
    opened = _opened(call, Report())
    if opened is None or not isinstance(opened[0], Drawing):
        return None
    drawing = replace(opened[0], units=call.units or _units(call, opened[0]))
    layers = call.layers or (_layer(call, drawing),)
    taken = take(drawing, layers, Report(), apart=True, least_um=_LEAST_UM)
    rings = () if taken is None else taken.outline.rings
    most = max((_reach_um(Outline(rings=(ring,))) for ring in rings), default=math.inf)
    if most > most_um:
        return None
    if len(rings) != 1 or not _is_disc(rings[0]):
        message = f"{call.part} is too small to be seen, and not one circle"
        hint = f"draw a bead as one circle, at most {most_um:.3g} um across"
        raise CallError(CODE, message, call.part, hint)
    return most / 2


def _is_disc(ring: Ring) -> bool:
    """Return whether a ring is round and filled."""
    x0, y0, x1, y1 = Outline(rings=(ring,)).bounds_um
    wide, high = x1 - x0, y1 - y0
    area = abs(ring.signed_area_um2) / (math.pi / 4 * wide * high)
    return abs(wide - high) < _ROUND * wide and abs(area - 1) < _ROUND


def _opened(call: PartCall, report: Report) -> tuple[AnyDrawing, str] | None:
    """Return the drawing, and the first unit that its file does not contradict.

    A DXF file contradicts none.
    """
    first = Report()
    for units in (call.units,) if call.units else _UNITS:
        data = _data(call, units, call.layers or ("0",))
        source, tried = _source(call, data), Report()
        found = open_named(
            Checked.of(source, []), "parts", PART, "drawing", report=tried
        )
        if found is not None:
            return found, units
        first.found = first.found or tried.found
    report.found.extend(_of_drawing(call, each) for each in first.found)
    return None


def _units(call: PartCall, drawing: Drawing) -> str:
    """Return the unit that a DXF file states."""
    known = header_unit(drawing.document.units)
    if known in UM_PER_UNIT:
        return str(known)
    is_in = "no unit" if known is None else f"the unit {known}"
    message = f"{call.part} states {is_in}"
    raise CallError(CODE, message, call.part, f"--units {', '.join(UM_PER_UNIT)}")


def _layer(call: PartCall, drawing: AnyDrawing) -> str:
    """Return the drawing's only layer that holds shapes."""
    held = shape_layers(drawing)
    if len(held) == 1:
        return held[0]
    shown = ", ".join(held[:12]) or "none"
    message = f"{call.part} has {len(held)} layers that hold shapes: {shown}"
    hint = "--layers names those that together are the part's outline, as A,B"
    raise CallError(CODE, message, call.part, hint)


def _source(call: PartCall, data: dict[str, Any]) -> Source:
    """Return data as if a file held them, without positions in it."""
    path, text = _folder(call) / _NO_FILE, yaml.safe_dump(data)
    file = os.path.relpath(path)
    source = parse(text, path, file, Report())
    if source is None:
        raise RuntimeError(f"no document: {text}")
    at, from_here = Span(file=str(call.part)), Span(file=file)
    # other files are named as seen from the one that there is not
    named = {("workcell",): from_here, ("parts", PART, "drawing", "file"): from_here}
    return replace(
        source,
        values=dict.fromkeys(source.values, at) | named,
        keys=dict.fromkeys(source.keys, at),
    )


def _of_drawing(call: PartCall, finding: Diagnostic) -> Diagnostic:
    """Return a finding at the drawing, where it names the file that there is not."""
    if Path(finding.where.file).name != _NO_FILE:
        return finding
    return replace(finding, where=replace(finding.where, file=str(call.part)))


def _folder(call: PartCall) -> Path:
    """Return the folder that holds both the drawing and the workcell."""
    paths = [os.path.realpath(path.parent) for path in (call.part, call.workcell)]
    try:
        return Path(os.path.commonpath(paths))
    except ValueError:  # on two drives
        message = f"{call.part} and {call.workcell} have no folder in common"
        raise CallError(CODE, message, call.part, "copy one to the other's") from None


def _data(call: PartCall, units: str, layers: Sequence[str]) -> dict[str, Any]:
    """Return the task as a file would hold it."""
    folder = _folder(call)
    drawing: dict[str, Any] = {
        "file": _inside(call.part, folder), "units": units, "layers": list(layers),
    }  # fmt: skip
    if call.cell is not None:
        drawing["cell"] = call.cell
    part: dict[str, Any] = {
        "drawing": drawing,
        "separate": True,
        "thickness_um": call.height_um or 0.0,
        "reflectance": _DARK if call.polarity == "dark" else _BRIGHT,
        "origin": "outline",
    }
    part["marks"] = _marks(call, part["reflectance"])
    target = PART
    if call.target is not None:
        part["features"] = {"target": _feature(call.target)}
        target = f"{PART}.target"
    start: dict[str, Any] = {"on": "stage", "x_um": 0, "y_um": 0}
    angle = None if call.near is None else call.near.theta_rad
    if angle is None:
        start["theta"] = "any"
    else:
        start |= {"theta_deg": math.degrees(angle), "sigma_theta_deg": _NEAR_DEG}
    return {
        "microplan": 1,
        "name": PART,
        "workcell": _inside(call.workcell, folder),
        "optimise": {"prefer": "fast"},
        "parts": {PART: part},
        "start": {"stage": {"x_um": 0, "y_um": 0, "z_um": 0, "theta_deg": 0},
                  PART: start},
        "steps": [{"id": STEP, "do": "locate", "target": target}],
    }  # fmt: skip


def _marks(call: PartCall, own: float) -> dict[str, dict[str, Any]]:
    """Return the faces on a part as its marks; `own` is the part's reflectance."""
    found: dict[str, dict[str, Any]] = {}
    for layer, ratio in call.faces or ():
        if not 0 <= ratio <= 1 / own:
            message = f"--faces {layer}: its ratio must be 0 to {1 / own:g}, is {ratio}"
            raise CallError(CODE, message, call.part)
        name = face_name(layer)
        if name in found:
            raise CallError(CODE, f"--faces has {layer} twice", call.part)
        found[name] = {"layer": layer, "reflectance": own * ratio}
    return found


def face_name(layer: str) -> str:
    """Return what the face on a layer is called in a task."""
    return "face_" + re.sub(r"[^A-Za-z0-9]+", "_", layer)[:40]


def _inside(path: Path, folder: Path) -> str:
    """Return a file's name from a folder that holds it."""
    whole = Path(os.path.realpath(path.parent)) / path.name
    return whole.relative_to(folder).as_posix()


def _feature(text: str) -> dict[str, Any]:
    """Return the feature that `KIND[:LAYER[:N]]` names: N teeth, or the Nth ring."""
    kind, *rest = text.split(":")
    if kind not in ("circle", "teeth", "notch", "outline") or len(rest) > 2:
        message = f"no target {text!r}"
        hint = "circle:LAYER, teeth:LAYER:COUNT, notch:LAYER, outline[:LAYER], each "
        raise CallError(CODE, message, hint=hint + "with :RING for one of several")
    found: dict[str, Any] = {"kind": kind}
    if rest:
        found["layer"] = rest[0]
    if len(rest) == 2:
        if not rest[1].isdecimal():
            raise CallError(CODE, f"{rest[1]!r} in the target {text!r} is no number")
        found["count" if kind == "teeth" else "ring"] = int(rest[1])
    return found


def _magnified(task: Task, call: PartCall) -> Task:
    """Return the task with the one magnification of the pictures."""
    optics, zoom = task.workcell.optics, magnification_of(task.workcell, call)
    fixed = replace(optics, magnification=(zoom, zoom))
    return replace(task, workcell=replace(task.workcell, optics=fixed))


def magnification_of(cell: Workcell, call: PartCall) -> float:
    """Return the magnification of a call's pictures; CallError if it is none."""
    low, high = cell.optics.magnification
    asked = call.magnification
    if asked is None and low < high:
        message = f"the workcell has magnifications from {low:g} to {high:g}"
        hint = "--magnification says which the pictures have"
        raise CallError(CODE, message, call.workcell, hint)
    zoom = low if asked is None else asked
    if not low <= zoom <= high:
        message = f"magnification {zoom:g} is outside the workcell's, {low:g} to "
        raise CallError(CODE, message + f"{high:g}", call.workcell)
    return zoom


def _sought(task: Task, call: PartCall) -> Task:
    """Return the task with how far from the middle its part may lie, and focus be."""
    scope = microscope_at(task.workcell, task.workcell.optics.magnification[0])
    um_per_px, (x_um, y_um) = scope.um_per_px, _place_um(call.near, scope)
    if call.near is not None:
        sigma_um = _NEAR_PX * um_per_px
    else:
        side_px = min(scope.width_px, scope.height_px)
        room_um = (side_px * um_per_px - _reach_um(task.parts[PART].outline)) / 2
        sigma_um = max(room_um - CONTEXT_UM, _NEAR_PX * um_per_px) / SEARCH_SIGMAS
    start = replace(task.part_starts[PART], x_um=x_um, y_um=y_um, sigma_xy_um=sigma_um)
    background = _BRIGHT if call.polarity == "dark" else _DARK
    stage = replace(task.workcell.stage, reflectance=background)
    tried = replace(
        task.benchmark,
        focus_sigma_um=_FOCUS_SHARE * scope.wave_depth_um,
        magnification_sigma=_SCALE,
        pose_sigma_xy_um=0.0,
        pose_sigma_theta_rad=0.0,
    )
    return replace(
        task,
        benchmark=tried,
        part_starts={PART: start},
        workcell=replace(task.workcell, stage=stage),
    )


def _place_um(near: NearPlace | None, scope: Microscope) -> Point:
    """Return where a part is about, world um."""
    if near is None:
        return (0.0, 0.0)
    if near.unit == "um":
        return (near.x, near.y)
    column, row = (scope.width_px - 1) / 2, (scope.height_px - 1) / 2
    k = scope.um_per_px
    return (k * (near.x - column), k * (row - near.y))


def _reach_um(outline: Outline) -> float:
    """Return the larger side of an outline's bounds."""
    x0, y0, x1, y1 = outline.bounds_um
    return max(x1 - x0, y1 - y0)
