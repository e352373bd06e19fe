"""Parts from their drawings: outlines, posts, features in the part's frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from microplan.arrays import Point
from microplan.optics.outline.outline import Outline, place
from microplan.planner.drawings.census import Taken
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.source.schema import Checked, with_defaults
from microplan.planner.task import features
from microplan.planner.task.drawings import AnyDrawing, DrawingSheet, open_named, take
from microplan.planner.task.features import NotFoundError
from microplan.planner.task.surfaces import surface
from microplan.planner.task.task import Part, PartFeature, Post


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
        taken = take(drawing, layers, report)
        if taken is not None:
            part = _part(task, name, drawing, taken, report)
            if part is not None:
                parts[name] = part
    return parts


def _part(
    task: Checked, name: str, drawing: AnyDrawing, taken: Taken, report: Report
) -> Part | None:
    """Return the part in the frame of its origin, None after an error."""
    outline = taken.outline
    errors = report.failed
    found = _features(task, name, outline, report)
    center = _origin(task, name, outline, found)
    outline = place(outline, -center[0], -center[1])
    posts, standing = _posts(task, name, drawing, center, report)
    if errors or report.failed or not task.good("parts", name):
        return None
    found = _features(task, name, outline, Report())  # again, in the part's frame
    if "outline" not in found and "outline" not in posts:
        about = (0.0, 0.0) if task.good("parts", name, "origin") else None
        at = task.source.key("parts", name)
        found["outline"] = _outline_feature("outline", {}, outline, about, at)
    raw = with_defaults(task.source.get("parts", name), "task", "part")
    return Part(
        name=name,
        outline=outline,
        thickness_um=float(raw["thickness_um"]),
        reflectance=float(raw["reflectance"]),
        surface=surface(raw, raw["material"]),
        material=raw["material"],
        profile_tolerance_um=float(raw["profile_tolerance_um"]),
        taper_um_per_100um=float(raw["taper_um_per_100um"]),
        features=found,
        posts=posts,
        chord_um=max(
            [taken.chord_um, *(feature.chord_um for feature in found.values())]
        ),
        sheet=DrawingSheet(drawing=drawing, takes=(taken, *standing)),
        where=task.source.key("parts", name),
    )


def _origin(
    task: Checked, name: str, outline: Outline, found: Mapping[str, PartFeature]
) -> Point:
    """Return the drawing's point that is the part's origin."""
    if not task.good("parts", name, "origin"):
        return (0.0, 0.0)
    origin = task.source.get("parts", name, "origin")
    if origin in found:
        return found[origin].center_um
    # an undeclared `outline` is the part as a whole; what else is missing was reported
    return features.extent(outline)[0] if origin == "outline" else (0.0, 0.0)


def _features(
    task: Checked, name: str, outline: Outline, report: Report
) -> dict[str, PartFeature]:
    """Return the declared features that the outline has, by name."""
    found: dict[str, PartFeature] = {}
    for key, raw in sorted(task.source.mapping("parts", name, "features").items()):
        where = ("parts", name, "features", key)
        if task.good(*where):
            at = task.source.key(*where)
            feature = _feature(key, raw, outline, at, report)
            if feature is not None:
                found[key] = feature
    return found


def _posts(
    task: Checked, name: str, drawing: AnyDrawing, origin: Point, report: Report
) -> tuple[dict[str, Post], list[Taken]]:
    """Return the posts that can be read, in the part's frame, and as drawn."""
    posts: dict[str, Post] = {}
    found: list[Taken] = []
    material = task.source.get("parts", name).get("material", "")
    for key, raw in sorted(task.source.mapping("parts", name, "posts").items()):
        where = ("parts", name, "posts", key)
        if task.good(*where):
            layer = task.source.value(*where, "layer")
            taken = take(drawing, [raw["layer"]], report, layer)
            if taken is not None:
                found.append(taken)
                shape = place(taken.outline, -origin[0], -origin[1])
                posts[key] = _post(key, raw, material, shape, task.source.key(*where))
    return posts, found


def _feature(
    name: str, raw: Mapping[str, Any], outline: Outline, at: Span, report: Report
) -> PartFeature | None:
    """Return a declared feature as the drawing has it."""
    layer = raw.get("layer")
    rings = outline.rings if layer is None else features.on_layer(outline, layer)
    try:
        if not rings:
            raise NotFoundError("the part's outline has no ring there")
        feature = _READERS[raw["kind"]](name, raw, Outline(rings=rings), at)
    except NotFoundError as error:
        message = f"no {raw['kind']} on layer '{layer}' for {name}: {error}"
        report.error("MP221", at, message, "name another layer, or mend the drawing")
        return None
    except _CountError as error:
        report.error("MP222", at, f"{name}: {error}", "mend the count or the drawing")
        return None
    if feature.chord_um:
        message = f"{name} is a polygon, taken for R {feature.radius_um:.6g} um"
        hint = f"its edges run up to {feature.chord_um:.3g} um inside the circle"
        report.fact("MP235", at, message, hint)
    return feature


class _CountError(ValueError):
    """The drawing has another number of teeth than the task."""


def _circle(name: str, raw: Mapping[str, Any], shape: Outline, at: Span) -> PartFeature:
    found = features.circle(shape.rings)
    return _make(
        name, raw, at, found.center_um, radius_um=found.radius_um, hole=found.hole,
        chord_um=found.chord_um,
    )  # fmt: skip


def _teeth(name: str, raw: Mapping[str, Any], shape: Outline, at: Span) -> PartFeature:
    found = features.teeth(shape.rings)
    if found.count != raw["count"]:
        raise _CountError(f"{raw['count']} teeth stated, {found.count} drawn")
    return _make(
        name, raw, at, found.center_um, radius_um=found.outer_um, count=found.count,
        root_um=found.root_um, phase_rad=found.phase_rad,
    )  # fmt: skip


def _notch(name: str, raw: Mapping[str, Any], shape: Outline, at: Span) -> PartFeature:
    found = features.notch(shape.rings)
    return _make(
        name, raw, at, found.center_um, radius_um=found.radius_um,
        phase_rad=found.angle_rad, width_um=found.width_um,
    )  # fmt: skip


def _whole(name: str, raw: Mapping[str, Any], shape: Outline, at: Span) -> PartFeature:
    return _outline_feature(name, raw, shape, None, at)


_READERS = {"circle": _circle, "teeth": _teeth, "notch": _notch, "outline": _whole}


def _outline_feature(
    name: str, raw: Mapping[str, Any], shape: Outline, center: Point | None, at: Span
) -> PartFeature:
    """Return the outline itself as a feature."""
    about, radius_um = features.extent(shape, center)
    raw = {"kind": "outline", **raw}
    return _make(name, raw, at, about, radius_um=radius_um)


def _make(
    name: str, raw: Mapping[str, Any], at: Span, center_um: Point, **values: Any
) -> PartFeature:
    """Return the feature; values that its kind does not have stay as they are."""
    return PartFeature(
        name=name, kind=raw["kind"], layer=raw.get("layer", ""), center_um=center_um,
        avoid=raw.get("avoid", False), where=at, **values,
    )  # fmt: skip


def _post(
    name: str, raw: Mapping[str, Any], material: str, shape: Outline, at: Span
) -> Post:
    """Return the post; its circle is that of its outer ring if it has one."""
    try:
        found = features.circle(shape.rings[:1])
        center, radius_um = found.center_um, found.radius_um
    except NotFoundError:
        center, radius_um = features.extent(shape)
    return Post(
        name=name, outline=shape, height_um=float(raw["height_um"]),
        reflectance=float(raw["reflectance"]), surface=surface(raw, material),
        profile_tolerance_um=float(raw.get("profile_tolerance_um", 0.0)),
        center_um=center, radius_um=radius_um, where=at,
    )  # fmt: skip
