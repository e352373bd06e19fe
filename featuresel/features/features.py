"""Features worth trying, proposed from an outline; declared ones join them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from microplan.featuresel.features.circles import (
    RingCircle,
    circles,
    rounded,
    to_feature,
)
from microplan.featuresel.features.feature import Feature, coincide, renamed
from microplan.featuresel.features.ring_cleanup import SAME, Clean, clean, extent_um
from microplan.featuresel.features.straight import (
    LONG,
    corner_features,
    edge_features,
    pair_features,
    sides,
)
from microplan.featuresel.features.symmetry import NEAR, centroid, curve, order_of
from microplan.featuresel.features.teeth import Notch, notch_of, teeth
from microplan.featuresel.routines.contract import TargetKind
from microplan.optics.outline.outline import Outline
from microplan.optics.outline.tolerant_order import least, ordered

# Per kind, the longest edges first: what says most of a position. A drawing of a
# thousand holes is not tried a thousand times.
MOST: dict[TargetKind, int] = {
    "outline": 1, "teeth": 3, "circle": 6, "edge": 6, "pair": 6, "corner": 6,
}  # fmt: skip
_MOST_RINGS = 200  # whose shape is compared with itself, the longest first
_MOST_SIDES = 64  # that are paired
# of the extent: above the rounding of coordinates, below what any drawing means; what
# is equal but for rounding goes by its position
_UNIT = 1e-6


def propose(outline: Outline) -> tuple[Feature, ...]:
    """Return the features of an outline that routines may find.

    Circles of which half is drawn, toothed rings with the notch that breaks their
    symmetry, straight edges, parallel pairs, corners, and the whole outline with the
    order of its own symmetry. They do not depend on how rings are run, where they
    start, how edges are split, or the scale.

    Parameters
    ----------
    outline : Outline
        Of one part, in its frame, um.

    Returns
    -------
    tuple of Feature
        Those with the longest edges first, at most `MOST` of each kind. Names count
        within a kind: circle1, circle2, teeth1, ..., outline1.
    """
    extent, rings = extent_um(outline), clean(outline)
    if not rings:
        return ()
    rounds = circles(rings)
    unit = _UNIT * extent
    longest = sorted(sides(rings, LONG * extent), key=lambda side: side.rank(unit))
    longest = longest[:_MOST_SIDES]
    found = [
        *_whole(outline, rings),
        *_toothed(rings, rounds),
        *map(to_feature, rounds),
        *edge_features(longest),
        *pair_features(longest),
        *corner_features(rings, longest),
    ]
    return _named(_distinct(found, SAME * extent), extent)


def merge(
    proposed: Sequence[Feature],
    declared: Sequence[Feature],
    avoided: Sequence[Feature] = (),
    *,
    within_um: float = 1e-3,
) -> tuple[Feature, ...]:
    """Return the features to try: declared ones, then proposed ones.

    Parameters
    ----------
    proposed : sequence of Feature
        From `propose`.
    declared : sequence of Feature
        The task's. A proposed one that coincides with one of them is that one: it goes
        by the declared name.
    avoided : sequence of Feature
        What the task forbids; whatever coincides is dropped.
    within_um : float
        Positions and sizes that are so near coincide. Both come from one drawing, which
        may say the same in other words.

    Raises
    ------
    ValueError
        If two declared features have one name.
    """
    names = [feature.name for feature in declared]
    if len(set(names)) < len(names):
        raise ValueError(f"declared names must differ, got {', '.join(names)}")

    def among(feature: Feature, others: Sequence[Feature]) -> bool:
        return any(coincide(feature, o, within_um=within_um) for o in others)

    kept = [f for f in declared if not among(f, avoided)]
    for feature in proposed:
        if not among(feature, avoided) and not among(feature, declared):
            kept.append(_unlike(feature, names))
    return tuple(kept)


def _whole(outline: Outline, rings: Sequence[Clean]) -> list[Feature]:
    """Return the whole outline; a symmetrical one about the centre of its symmetry."""
    shown = ordered(rings, lambda ring: -ring.length_um)[:_MOST_RINGS]
    shape = curve(shown, centroid(rings))
    order, alike, other = order_of(shape)
    x0, y0, x1, y1 = outline.bounds_um
    middle = ((x0 + x1) / 2, (y0 + y1) / 2)
    center = middle if order == 1 else shape.center_um
    reach = max(math.dist(p, center) for ring in rings for p in ring.points)
    return [
        Feature(
            kind="outline",
            center_um=center,
            parameters={"extent_um": reach},
            symmetry=order,
            finest_um=max(min(x1 - x0, y1 - y0), NEAR * reach),
            bright=True,
            edge_um=sum(ring.length_um for ring in rings),
            alike=alike,
            alike_rad=math.tau / other,
        )
    ]


def _toothed(rings: Sequence[Clean], rounds: Sequence[RingCircle]) -> list[Feature]:
    """Return the toothed rings, each with its bore and notch."""
    found = []
    for ring in ordered(rings, lambda ring: -ring.length_um)[:_MOST_RINGS]:
        toothed = teeth(ring, [circle.center_um for circle in rounds])
        if toothed is not None:
            feature, notch = toothed
            found.append(_with_bore(feature, notch, rings, rounds))
    return found


def _with_bore(
    feature: Feature, notch: Notch | None, rings: Sequence[Clean],
    rounds: Sequence[RingCircle],
) -> Feature:  # fmt: skip
    """Return teeth with the round hole about their centre, and the notch in either."""
    parameters = dict(feature.parameters)
    bores = [
        c for c in rounds
        if c.hole and c.radius_um < parameters["root_um"]
        and math.dist(c.center_um, feature.center_um) <= NEAR * parameters["outer_um"]
    ]  # fmt: skip
    if bores:
        bore = least(bores, lambda c: -c.radius_um)
        parameters["bore_um"] = bore.radius_um
        cut = [n for ring in rings if rounded(ring, bore)
               if (n := notch_of(ring, bore)) is not None]  # fmt: skip
        notch = notch or (cut[0] if cut else None)
    if notch is None:
        return replace(feature, parameters=parameters)
    parameters["notch_rad"] = notch.angle_rad
    parameters["notch_radius_um"] = notch.radius_um
    parameters["notch_width_um"] = notch.width_um
    return replace(
        feature,
        parameters=parameters,
        symmetry_broken_by="notch",
        finest_um=min(feature.finest_um, notch.width_um),
        # without the notch a tooth looks like the next
        alike=1 - notch.edge_um / (feature.edge_um + notch.edge_um),
    )


def _distinct(found: Sequence[Feature], within_um: float) -> list[Feature]:
    """Return the features without repetitions, the first of each."""
    kept: list[Feature] = []
    for feature in found:
        if not any(coincide(feature, k, within_um=within_um) for k in kept):
            kept.append(feature)
    return kept


def _named(found: Sequence[Feature], extent: float) -> tuple[Feature, ...]:
    """Return the longest features of each kind with their names, longest first."""

    def rank(feature: Feature) -> tuple[float, ...]:
        unit = _UNIT * extent
        near = (feature.edge_um, *feature.center_um, *_sizes(feature))
        rounded_to = [round(value / unit) for value in near]
        return (-rounded_to[0], *rounded_to[1:], round(feature.angle_rad, 6))

    counts: dict[TargetKind, int] = dict.fromkeys(MOST, 0)
    kept = []
    for feature in sorted(found, key=rank):
        if counts[feature.kind] < MOST[feature.kind]:
            counts[feature.kind] += 1
            kept.append(renamed(feature, f"{feature.kind}{counts[feature.kind]}"))
    return tuple(kept)


def _sizes(feature: Feature) -> list[float]:
    """Return the feature's lengths in a fixed order."""
    names = sorted(name for name in feature.parameters if name.endswith("_um"))
    return [feature.parameters[name] for name in names]


def _unlike(feature: Feature, taken: Sequence[str]) -> Feature:
    """Return the feature under a name that is not taken."""
    name = feature.name
    while name in taken:
        name += "_drawn"
    return renamed(feature, name)
