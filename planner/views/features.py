"""Features of a look's part other than its target: proposed, declared, not avoided."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from microplan.arrays import Box
from microplan.featuresel.features.feature import (
    Feature,
    coincide,
    is_circle_alone,
    renamed,
)
from microplan.featuresel.features.features import merge, propose
from microplan.optics.outline.outline import Outline
from microplan.optics.outline.tolerant_order import ordered
from microplan.planner.task.surfaces import Surface, surfaces
from microplan.planner.task.task import Part, PartFeature, Task
from microplan.planner.views.targets import TargetShape, declared_shape, surface_of

SAME_UM = 1e-3  # positions of one feature in a drawing are this near to each other
# what reaches farthest from a feature's reference point, first found first used
_REACHES = ("outer_um", "radius_um", "extent_um", "reach_um")


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposals:
    """Features that may replace a look's target, or join it."""

    target: Feature | None  # what the outline says of the target itself; None: nothing
    others: tuple[tuple[Feature, TargetShape], ...]  # in the order to try them
    avoided: tuple[tuple[str, str], ...] = ()  # name and kind of what the task forbids


def proposals(task: Task, shape: TargetShape) -> Proposals:
    """Return the features that lie at the height of the target, on its part.

    Those that its outline has, be it the part's, a post's or a mark's, and those that
    the task declares on the same face or on marks of it. Jaws have none but themselves.
    """
    part = task.parts.get(shape.owner)
    if part is None:
        return Proposals(target=None, others=())
    face = surface_of(part, shape)
    level = _declared(part, face)
    declared = [f for f, shown in level if not shown.avoid and shown.kind != "notch"]
    avoided = [f for f, shown in level if shown.avoid]
    proposed = propose(face.outline)
    if any(shown.kind == "notch" and shown.avoid for _, shown in level):
        proposed = tuple(map(_without_notch, proposed))
    aim = replace(drawn(shape), region=_region(shape, face.body(part.name)))
    found = merge(proposed, declared, avoided, within_um=SAME_UM)
    same = [f for f in proposed if coincide(f, aim, within_um=SAME_UM)]
    rest = [f for f in found if not coincide(f, aim, within_um=SAME_UM)]
    rounds = [f for f in (*same, *rest) if f.kind == "circle"]
    rest = [f for f in rest if not any(is_circle_alone(f, c) for c in rounds)]
    names = {feature.name for feature in declared}
    return Proposals(
        target=renamed(same[0], shape.name) if same else None,
        others=tuple(
            _other(part, face, feature, proposed, declared=feature.name in names)
            for feature in _by_kinds([_as_proposed(f, proposed) for f in rest])
        ),
        avoided=tuple(
            (f"{part.name}.{shown.name}", shown.kind)
            for _, shown in level
            if shown.avoid
        ),
    )


def _declared(part: Part, face: Surface) -> list[tuple[Feature, PartFeature]]:
    """Return the declared features at a face's height, as proposals have them."""
    body, heights = face.body(part.name), surfaces(part)
    found = []
    for feature in part.features.values():
        if heights[feature.on].z_um == face.z_um:
            shape = declared_shape(part, feature, f"{part.name}.{feature.name}")
            as_drawn = renamed(drawn(shape), feature.name)
            found.append((replace(as_drawn, region=_region(shape, body)), feature))
    return found


def _region(shape: TargetShape, body: str) -> str:
    """Return which ring a shape is, seen from a body; "" for all of its own."""
    if shape.kind != "outline" or (shape.body, shape.ring) == (body, None):
        return ""
    return f"{shape.body}/{'' if shape.ring is None else shape.ring}"


def _other(
    part: Part, face: Surface, feature: Feature, proposed: Sequence[Feature], *,
    declared: bool,
) -> tuple[Feature, TargetShape]:  # fmt: skip
    """Return a feature as one that may be measured, under its name in the plan.

    What is declared of another face's outline is as the task has it.
    """
    drawn_here = any(coincide(feature, p, within_um=SAME_UM) for p in proposed)
    if declared:
        name = f"{part.name}.{feature.name}"
        if not drawn_here:
            shape = declared_shape(part, part.features[feature.name], name)
            return renamed(feature, shape.name), shape
    else:
        name = f"{face.body(part.name)}.{feature.name}"
    return renamed(feature, name), _shape(part.name, name, feature, face)


def _by_kinds(features: Sequence[Feature]) -> list[Feature]:
    """Return features of different kinds first, of a kind those with longer edges.

    Edges, pairs and corners of one ring measure much the same.
    """
    found: list[tuple[int, Feature]] = []
    for kind in {feature.kind for feature in features}:
        same = [f for f in features if f.kind == kind]
        named = sorted(same, key=lambda feature: feature.name)
        found += enumerate(ordered(named, lambda feature: -feature.edge_um))
    found.sort(key=lambda row: (row[0], row[1].name))
    ranked = ordered(found, lambda row: -row[1].edge_um)
    return [feature for _, feature in sorted(ranked, key=lambda row: row[0])]


def drawn(shape: TargetShape) -> Feature:
    """Return a shape as a feature; it says nothing of the length of its edges."""
    return Feature(
        name=shape.name,
        kind=shape.kind,
        center_um=shape.center_um,
        angle_rad=shape.angle_rad,
        parameters=shape.parameters,
        symmetry=shape.symmetry,
        symmetry_broken_by=shape.symmetry_broken_by,
        finest_um=shape.finest_um,
        bright=shape.bright,
        edge_um=math.tau * _reach(shape.parameters) or shape.finest_um,
    )


def offset_um(shape: TargetShape, about: TargetShape) -> tuple[float, float]:
    """Return a shape's position from another of its owner, in its axes, um."""
    (x, y), (x0, y0) = shape.center_um, about.center_um
    return (x - x0, y - y0)


def _as_proposed(feature: Feature, proposed: tuple[Feature, ...]) -> Feature:
    """Return a declared feature with what its outline says of it."""
    for other in proposed:
        if coincide(feature, other, within_um=SAME_UM):
            return replace(other, name=feature.name)
    return feature


def _without_notch(feature: Feature) -> Feature:
    """Return teeth without the notch that distinguishes one from the next."""
    if feature.kind != "teeth" or not feature.symmetry_broken_by:
        return feature
    kept = {k: v for k, v in feature.parameters.items() if not k.startswith("notch_")}
    return replace(feature, parameters=kept, symmetry_broken_by="", alike=0.0)


def _shape(owner: str, name: str, feature: Feature, face: Surface) -> TargetShape:
    """Return a feature of a face as a target."""
    return TargetShape(
        name=name,
        owner=owner,
        body=face.body(owner),
        kind=feature.kind,
        center_um=feature.center_um,
        angle_rad=feature.angle_rad,
        box_um=_box(feature, face.outline),
        finest_um=feature.finest_um,
        bright=feature.bright == face.bright,
        symmetry=feature.symmetry,
        symmetry_broken_by=feature.symmetry_broken_by,
        parameters=feature.parameters,
    )


def _box(feature: Feature, outline: Outline) -> Box:
    """Return what must be in view at any angle, about the reference point."""
    reach = _reach(feature.parameters)
    if not reach:
        x0, y0, x1, y1 = outline.bounds_um
        reach = math.hypot(x1 - x0, y1 - y0) / 2
    return (-reach, -reach, reach, reach)


def _reach(parameters: Mapping[str, float]) -> float:
    """Return how far a feature's edges are from its reference point."""
    for name in _REACHES:
        if name in parameters:
            return parameters[name]
    sides = [parameters.get(name, 0.0) for name in ("length_um", "width_um")]
    return math.hypot(*sides) / 2
