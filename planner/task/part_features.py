"""Declared features of a part, found in the outlines of its faces."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from microplan.arrays import Point
from microplan.optics.outline.outline import Outline, Ring
from microplan.planner.source.diagnostics import Report, Span
from microplan.planner.source.schema import Checked
from microplan.planner.task.regions import features
from microplan.planner.task.regions.features import NotFoundError
from microplan.planner.task.regions.rings import by_size, listed, nearest
from microplan.planner.task.regions.symmetry import centroid, symmetry_order
from microplan.planner.task.surfaces import OWN
from microplan.planner.task.task import PartFeature

_CHOOSE = "say 'ring: 1' for the first, or 'at: [x, y]' for one around or near a point"


def read_features(
    task: Checked,
    part: str,
    faces: Mapping[str, Outline],
    *,
    unit_um: float,
    origin: Point,
    report: Report,
    unread: Collection[str] = (),
) -> dict[str, PartFeature]:
    """Return the declared features that a part's faces have, by name.

    Parameters
    ----------
    task : Checked
        The task.
    part : str
        Which part.
    faces : mapping of str to Outline
        By name, the part's own first: a layer of several means the first.
    unit_um : float
        The drawing's unit.
    origin : (x, y)
        Where the drawing has the origin of the faces' frame, um.
    report : Report
        Receives what is not found.
    unread : collection of str
        Layers, in lower case, of which something was reported: features on them are
        left out.
    """
    found: dict[str, PartFeature] = {}
    for key, raw in sorted(task.source.mapping("parts", part, "features").items()):
        where = ("parts", part, "features", key)
        if not task.good(*where) or raw.get("layer", "").lower() in unread:
            continue
        if "ring" in raw and "at" in raw:
            message = f"key 'at' means nothing beside 'ring' in {'.'.join(where)}"
            report.error("MP109", task.source.key(*where, "at"), message, "remove it")
            continue
        x, y = raw.get("at", (0.0, 0.0))
        point_um = (x * unit_um - origin[0], y * unit_um - origin[1])
        at = task.source.key(*where)
        feature = _feature(key, raw, faces, point_um, unit_um, at, report)
        if feature is not None:
            found[key] = feature
    return found


def whole_outline(
    name: str, raw: Mapping[str, Any], shape: Outline, center: Point | None, at: Span
) -> PartFeature:
    """Return a whole outline as a feature, about the middle of its bounds if not given.

    `raw` has the keys that the task states.
    """
    about, radius_um = features.extent(shape, center)
    raw = {"kind": "outline", **raw}
    return _make(name, raw, at, about, radius_um=radius_um)


def _feature(
    name: str, raw: Mapping[str, Any], faces: Mapping[str, Outline], point_um: Point,
    unit_um: float, at: Span, report: Report,
) -> PartFeature | None:  # fmt: skip
    """Return a declared feature as the drawing has it."""
    if raw["kind"] == "outline" and not {"layer", "ring", "at"} & raw.keys():
        return whole_outline(name, raw, faces[OWN], None, at)
    on, rings = _rings(faces, raw.get("layer"))
    there = f" on layer '{raw['layer']}'" if "layer" in raw else ""
    try:
        chosen = _chosen(raw, rings, point_um)
        if raw["kind"] == "outline":
            feature = _region(name, raw, on, faces[on], chosen, at)
        else:
            feature = _READERS[raw["kind"]](name, raw, on, chosen, at)
    except NotFoundError as error:
        message = f"no {raw['kind']}{there} for {name}: {error}"
        report.error("MP221", at, message, "name another layer, or mend the drawing")
        return None
    except _CountError as error:
        report.error("MP222", at, f"{name}: {error}", "mend the count or the drawing")
        return None
    except _SeveralError:
        message = (
            f"{len(chosen)} rings{there} could be {name}, in the drawing's units: "
            f"{listed(chosen, unit_um)}"
        )
        report.error("MP228", at, message, _CHOOSE)
        return None
    if feature.chord_um:
        message = f"{name} is a polygon, taken for R {feature.radius_um:.6g} um"
        hint = f"its edges run up to {feature.chord_um:.3g} um inside the circle"
        report.fact("MP235", at, message, hint)
    return feature


class _CountError(ValueError):
    """The drawing has another number of teeth than the task."""


class _SeveralError(ValueError):
    """Any of several rings could be meant."""


def _rings(
    faces: Mapping[str, Outline], layer: str | None
) -> tuple[str, tuple[Ring, ...]]:
    """Return the first face with rings from a layer, and those; no layer: its own."""
    if layer is None:
        return OWN, faces[OWN].rings
    for name, outline in faces.items():
        if rings := features.on_layer(outline, layer):
            return name, rings
    return OWN, ()


def _chosen(
    raw: Mapping[str, Any], rings: Sequence[Ring], point_um: Point
) -> Sequence[Ring]:
    """Return the rings that a feature may be, the one that `ring` or `at` names."""
    if not rings:
        raise NotFoundError(
            "neither the part's outline nor a post or mark has a ring there"
        )
    if "at" in raw:
        return (nearest(rings, point_um),)
    if "ring" not in raw:
        return rings
    if raw["ring"] > len(rings):
        raise NotFoundError(f"ring {raw['ring']} of {len(rings)}")
    return (by_size(rings)[int(raw["ring"]) - 1],)


def _region(
    name: str, raw: Mapping[str, Any], on: str, face: Outline, rings: Sequence[Ring],
    at: Span,
) -> PartFeature:  # fmt: skip
    """Return a ring of a face as a feature, about its centroid."""
    if len(rings) > 1:
        raise _SeveralError
    (ring,) = rings
    center, radius_um = features.extent(Outline(rings=(ring,)), centroid([ring]))
    return _make(
        name, raw, at, center, radius_um=radius_um, on=on, region=True,
        hole=ring.signed_area_um2 < 0, symmetry=symmetry_order(ring),
        ring=face.rings.index(ring) if len(face.rings) > 1 else None,
    )  # fmt: skip


def _circle(
    name: str, raw: Mapping[str, Any], on: str, rings: Sequence[Ring], at: Span
) -> PartFeature:
    found = features.circle(rings)
    return _make(
        name, raw, at, found.center_um, radius_um=found.radius_um, hole=found.hole,
        chord_um=found.chord_um, on=on,
    )  # fmt: skip


def _teeth(
    name: str, raw: Mapping[str, Any], on: str, rings: Sequence[Ring], at: Span
) -> PartFeature:
    found = features.teeth(rings, raw["count"])
    if found.count != raw["count"]:
        raise _CountError(f"{raw['count']} teeth stated, {found.count} drawn")
    return _make(
        name, raw, at, found.center_um, radius_um=found.outer_um, count=found.count,
        root_um=found.root_um, phase_rad=found.phase_rad, on=on,
    )  # fmt: skip


def _notch(
    name: str, raw: Mapping[str, Any], on: str, rings: Sequence[Ring], at: Span
) -> PartFeature:
    found = features.notch(rings)
    return _make(
        name, raw, at, found.center_um, radius_um=found.radius_um,
        phase_rad=found.angle_rad, width_um=found.width_um, on=on,
    )  # fmt: skip


_READERS = {"circle": _circle, "teeth": _teeth, "notch": _notch}


def _make(
    name: str, raw: Mapping[str, Any], at: Span, center_um: Point, **values: Any
) -> PartFeature:
    """Return the feature; values that its kind does not have stay as they are."""
    return PartFeature(
        name=name, kind=raw["kind"], layer=raw.get("layer", ""), center_um=center_um,
        avoid=raw.get("avoid", False), where=at, **values,
    )  # fmt: skip
