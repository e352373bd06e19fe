"""Rings of an insertion's hole and peg, found in the parts' drawings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from microplan.optics.outline.outline import Outline, Ring, place
from microplan.planner.assembly.fits.peg_in_hole import PegInHole
from microplan.planner.task.regions import features
from microplan.planner.task.regions.features import NotFoundError
from microplan.planner.task.task import Part, PartFeature, Post


@dataclass(frozen=True, slots=True, kw_only=True)
class Mates:
    """Rings that may be the hole, and that may be the peg; one each, or it is unclear.

    Both are in their part's frame.
    """

    holes: tuple[Ring, ...]
    pegs: tuple[Ring, ...]

    @property
    def are_clear(self) -> bool:
        """Return whether there is one ring of each."""
        return len(self.holes) == len(self.pegs) == 1

    @property
    def unclear(self) -> str:
        """Return what is ambiguous about the fit, "" if nothing is."""
        for what, rings in (("hole", self.holes), ("post", self.pegs)):
            if len(rings) > 1:
                sizes = ", ".join(_box(ring) for ring in rings[:8])
                return f"the {what} may be any of {len(rings)} rings, um: {sizes}"
        return ""

    @property
    def are_round(self) -> bool:
        """Return whether both are whole circles, drawn as arcs or as polygons."""
        return all(
            features.is_round(Outline(rings=rings)) for rings in (self.holes, self.pegs)
        )


def mates_of(part: Part, feature: PartFeature, post: Post) -> Mates:
    """Return the rings of a feature that are holes, and those that bound a post."""
    return Mates(
        holes=_holes(part.outline, feature),
        pegs=tuple(r for r in post.outline.rings if r.signed_area_um2 > 0),
    )


def _holes(outline: Outline, feature: PartFeature) -> tuple[Ring, ...]:
    """Return the rings of a feature that are holes: of a circle the one it is on."""
    rings: Sequence[Ring] = outline.rings
    if feature.ring is not None:
        rings = (outline.rings[feature.ring],)
    elif feature.layer:
        rings = features.on_layer(outline, feature.layer)
    if feature.kind == "circle":
        try:
            rings = (features.circle(rings).ring,)
        except NotFoundError:
            return ()
    return tuple(ring for ring in rings if ring.signed_area_um2 < 0)


def _box(ring: Ring) -> str:
    x0, y0, x1, y1 = Outline(rings=(ring,)).bounds_um
    return f"{x1 - x0:.4g} x {y1 - y0:.4g}"


def shape_of(
    mates: Mates, feature: PartFeature, post: Post, angle_rad: float
) -> PegInHole:
    """Return a fit whose rings are about the reference points of feature and post."""
    (x, y), (px, py) = feature.center_um, post.center_um
    return PegInHole(
        hole=place(Outline(rings=mates.holes), -x, -y),
        peg=place(Outline(rings=mates.pegs), -px, -py),
        angle_rad=angle_rad,
    )
