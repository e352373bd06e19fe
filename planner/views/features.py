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
from microplan.planner.task.task import Part, PartFeature, Task
from microplan.planner.views.requests import Request
from microplan.planner.views.targets import TargetShape, declared_shape

SAME_UM = 1e-3  # positions of one feature in a drawing are this near to each other
# what reaches farthest from a feature's reference point, first found first used
_REACHES = ("outer_um", "radius_um", "extent_um", "reach_um")


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposals:
    """Features that may replace a look's target, or join it."""

    target: Feature | None  # what the outline says of the target itself; None: nothing
    others: tuple[tuple[Feature, TargetShape], ...]  # in the order to try them
    avoided: tuple[tuple[str, str], ...] = ()  # name and kind of what the task forbids


def proposals(task: Task, request: Request, shape: TargetShape) -> Proposals:
    """Return the features of the body whose face holds the target.

    A part's own outline, or a post's: all of them lie at the target's height. Jaws have
    none but themselves.
    """
    part = task.parts.get(shape.owner)
    if part is None:
        return Proposals(target=None, others=())
    post = part.posts.get(request.target.partition(".")[2])
    declared: list[Feature] = []
    avoided: list[Feature] = []
    if post is not None:
        outline = post.outline
    else:
        outline = part.outline
        own = [f for f in part.features.values() if f.kind != "notch"]
        declared = [_drawn(part, f) for f in own if not f.avoid]
        avoided = [_drawn(part, f) for f in part.features.values() if f.avoid]
    proposed = propose(outline)
    if any(f.kind == "notch" and f.avoid for f in part.features.values()):
        proposed = tuple(map(_without_notch, proposed))
    aim = drawn(shape)
    found = merge(proposed, declared, avoided, within_um=SAME_UM)
    found = tuple(_as_proposed(feature, proposed) for feature in found)
    same = [f for f in proposed if coincide(f, aim, within_um=SAME_UM)]
    rest = [f for f in found if not coincide(f, aim, within_um=SAME_UM)]
    rounds = [f for f in (*same, *rest) if f.kind == "circle"]
    rest = [f for f in rest if not any(is_circle_alone(f, c) for c in rounds)]
    body = shape.owner if post is None else request.target
    bright = post is None or post.reflectance > part.reflectance
    return Proposals(
        target=renamed(same[0], shape.name) if same else None,
        others=tuple(
            (
                renamed(feature, f"{body}.{feature.name}"),
                _shape(
                    shape.owner,
                    f"{body}.{feature.name}",
                    feature,
                    outline,
                    bright=bright,
                ),
            )
            for feature in _by_kinds(rest)
        ),
        avoided=tuple(
            (f"{part.name}.{f.name}", f.kind)
            for f in part.features.values()
            if f.avoid and post is None
        ),
    )


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


def _drawn(part: Part, declared: PartFeature) -> Feature:
    """Return a declared feature as proposals have it."""
    shape = declared_shape(part, declared, f"{part.name}.{declared.name}")
    return renamed(drawn(shape), declared.name)


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


def _shape(
    owner: str, name: str, feature: Feature, outline: Outline, *, bright: bool
) -> TargetShape:
    """Return a feature as a target; `bright` is that of its body."""
    return TargetShape(
        name=name,
        owner=owner,
        kind=feature.kind,
        center_um=feature.center_um,
        angle_rad=feature.angle_rad,
        box_um=_box(feature, outline),
        finest_um=feature.finest_um,
        bright=feature.bright == bright,
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
