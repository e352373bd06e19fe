"""Parts from their drawings: outlines, posts, marks, features in the part's frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from microplan.arrays import Point
from microplan.optics.outline.outline import Outline, place
from microplan.planner.drawings.census import Taken
from microplan.planner.drawings.drawing_findings import UM_PER_UNIT
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.source.schema import Checked, with_defaults
from microplan.planner.task.drawings import AnyDrawing, DrawingSheet, open_named, take
from microplan.planner.task.finishes import surface_finish
from microplan.planner.task.part_features import read_features, whole_outline
from microplan.planner.task.regions import features
from microplan.planner.task.regions.features import NotFoundError
from microplan.planner.task.regions.symmetry import centroid, symmetry_order
from microplan.planner.task.surfaces import (
    OWN,
    check_marks,
    read_marks,
    take_marks,
    unread_layers,
)
from microplan.planner.task.task import Part, PartFeature, Post

CENTRE = "centre"  # an origin: the centroid of the outline's area


def read_parts(task: Checked, report: Report) -> dict[str, Part]:
    """Return the parts that can be read, by name; what cannot is reported."""
    parts: dict[str, Part] = {}
    names = task.source.mapping("parts")
    for name in sorted(names):
        if not task.good("parts", name, "drawing"):
            continue
        where = ("parts", name)
        drawing = open_named(task, *where, "drawing", report=report)
        if drawing is None:
            continue
        layers = names[name]["drawing"]["layers"]
        apart = names[name].get("separate", False)
        taken = take(drawing, layers, report, apart=apart)
        if taken is not None:
            part = _part(task, name, drawing, taken, report)
            if part is not None:
                parts[name] = part
    return parts


def _part(
    task: Checked, name: str, drawing: AnyDrawing, taken: Taken, report: Report
) -> Part | None:
    """Return the part in the frame of its origin, None after an error."""
    errors = report.failed
    unit_um = UM_PER_UNIT[task.source.get("parts", name, "drawing", "units")]
    posts = _take_posts(task, name, drawing, report)
    marks = take_marks(task, name, drawing, report)
    takes = {OWN: taken, **posts, **marks}
    faces = {key: each.outline for key, each in takes.items()}
    check_marks(task, name, faces, report)
    found = read_features(
        task,
        name,
        faces,
        unit_um=unit_um,
        origin=(0.0, 0.0),
        report=report,
        unread=unread_layers(task, name, faces),
    )
    origin = _origin(task, name, unit_um, taken.outline, found)
    if errors or report.failed or not task.good("parts", name):
        return None
    faces = {key: place(o, -origin[0], -origin[1]) for key, o in faces.items()}
    found = read_features(  # again, in the part's frame
        task, name, faces, unit_um=unit_um, origin=origin, report=Report()
    )
    if "outline" not in found and "outline" not in posts:
        about = (0.0, 0.0) if task.good("parts", name, "origin") else None
        at = task.source.key("parts", name)
        found["outline"] = whole_outline("outline", {}, faces[OWN], about, at)
    raw = with_defaults(task.source.get("parts", name), "task", "part")
    return Part(
        name=name,
        outline=faces[OWN],
        thickness_um=float(raw["thickness_um"]),
        reflectance=float(raw["reflectance"]),
        surface=surface_finish(raw, raw["material"]),
        material=raw["material"],
        profile_tolerance_um=float(raw["profile_tolerance_um"]),
        taper_um_per_100um=float(raw["taper_um_per_100um"]),
        features=found,
        posts={
            key: _post(
                key,
                post,
                faces[key],
                task.source.key("parts", name, "posts", key),
                material=raw["material"],
            )
            for key, post in sorted(raw["posts"].items())
        },
        marks=read_marks(task, name, marks, origin),
        chord_um=max(
            [taken.chord_um, *(feature.chord_um for feature in found.values())]
        ),
        sheet=DrawingSheet(drawing=drawing, takes=tuple(takes.values())),
        where=task.source.key("parts", name),
    )


def _origin(
    task: Checked, name: str, unit_um: float, outline: Outline,
    found: Mapping[str, PartFeature],
) -> Point:  # fmt: skip
    """Return the drawing's point that is the part's origin, um."""
    if not task.good("parts", name, "origin"):
        return (0.0, 0.0)
    origin: str | Sequence[float] = task.source.get("parts", name, "origin")
    if not isinstance(origin, str):
        x, y = origin
        return (x * unit_um, y * unit_um)
    if origin in found:
        return found[origin].center_um
    if origin == CENTRE:
        return centroid(outline.rings)
    # an undeclared `outline` is the part as a whole; what else is missing was reported
    return features.extent(outline)[0] if origin == "outline" else (0.0, 0.0)


def _take_posts(
    task: Checked, name: str, drawing: AnyDrawing, report: Report
) -> dict[str, Taken]:
    """Return what the layers of a part's posts enclose, by the posts' names."""
    found: dict[str, Taken] = {}
    for key, raw in sorted(task.source.mapping("parts", name, "posts").items()):
        where = ("parts", name, "posts", key)
        if task.good(*where):
            layer = task.source.value(*where, "layer")
            taken = take(drawing, [raw["layer"]], report, layer)
            if taken is not None:
                found[key] = taken
    return found


def _post(
    name: str, raw: Mapping[str, Any], shape: Outline, at: Span, *, material: str
) -> Post:
    """Return the post; its circle is that of its outer ring if it has one."""
    try:
        found = features.circle(shape.rings[:1])
        center, radius_um = found.center_um, found.radius_um
    except NotFoundError:
        center, radius_um = features.extent(shape, centroid(shape.rings[:1]))
    order = 0 if features.is_round(shape) else symmetry_order(shape.rings[0])
    return Post(
        name=name, outline=shape, height_um=float(raw["height_um"]),
        reflectance=float(raw["reflectance"]), surface=surface_finish(raw, material),
        profile_tolerance_um=float(raw.get("profile_tolerance_um", 0.0)),
        center_um=center, radius_um=radius_um, symmetry=order, where=at,
    )  # fmt: skip
