"""Features a look can aim at, in the part's frame, with the share of them seen."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from microplan.arrays import FloatArray, Point
from microplan.featuresel.routines.contour.polarity import FAINT
from microplan.featuresel.routines.contract import Occluders, Target, TargetKind

# Of the most light that any of the edges sends through: at the middle of a blurred edge
# of the occluder half of it comes through.
_THROUGH = 0.5


def seen_share(
    target: Target, occluders: Occluders, *, contrast: float
) -> float | None:
    """Return the share of a target's edges that is seen at its nominal pose.

    What lets through so little that the target's contrast drowns hides it, even where
    nothing lets through more.

    Parameters
    ----------
    target : Target
        With its contour, whose points are evenly along the edges.
    occluders : Occluders
        In front of it, (rows, columns) of the region.
    contrast : float
        Of the target alone in the look's light, from dark to bright, full scale 1.

    Returns
    -------
    float or None
        0..1; None for a target without a contour.
    """
    if not target.contour:
        return None
    column, row = contour_px(target)
    rows, columns = occluders.through.shape
    # pixels' areas reach half a pixel beyond their centres
    inside = (column > -0.5) & (column < columns - 0.5)
    inside &= (row > -0.5) & (row < rows - 0.5)
    at = (
        np.rint(row[inside]).astype(np.intp).clip(0, rows - 1),
        np.rint(column[inside]).astype(np.intp).clip(0, columns - 1),
    )
    through = occluders.through[at]
    is_plain = through * contrast >= FAINT
    is_clear = through > _THROUGH * float(through.max(initial=0.0))
    return float(np.count_nonzero(is_plain & is_clear) / len(column))


def contour_px(target: Target) -> tuple[FloatArray, FloatArray]:
    """Return columns and rows, (N,) px each, of a target's contour at its nominal pose.

    The target must have one.
    """
    x, y = np.array(target.contour)[:, :2].T
    c, s = math.cos(target.theta_rad), math.sin(target.theta_rad)
    column = target.column + target.px_per_um * (c * x - s * y)
    row = target.row - target.px_per_um * (s * x + c * y)
    return column, row


# what distinguishes two features of one kind and position
_SIZES = ("radius_um", "outer_um", "extent_um", "length_um", "width_um", "reach_um")

# of the radius: a polygon that is taken for a circle lies this near to it
_ROUND = 1e-2


@dataclass(frozen=True, slots=True, kw_only=True)
class Feature:
    """Part of an outline that a routine can find; parameters as in `Target`."""

    name: str = ""
    kind: TargetKind
    center_um: Point  # reference point in the part's frame
    angle_rad: float = 0.0  # of the feature's frame in the part's
    parameters: Mapping[str, float] = field(default_factory=dict)
    symmetry: int = 1  # order of the rotational symmetry; 1 = none, 0 = any turn
    symmetry_broken_by: str = ""
    finest_um: float  # smallest detail that a routine needs resolved
    bright: bool  # brighter than what surrounds it, if the part is
    edge_um: float  # length of its drawn edges, which determines its precision
    region: str = ""  # outline: which ring it is, by any name; "": all of the body
    # largest share of those edges that meets itself under a turn the symmetry does not
    # have: what a wrong answer would look like; and that turn, the smallest such
    alike: float = 0.0
    alike_rad: float = math.tau

    def __post_init__(self) -> None:
        values = (*self.center_um, self.angle_rad, *self.parameters.values())
        if not all(math.isfinite(value) for value in values):
            raise ValueError(f"numbers of {self.name!r} must be finite, got {values}")
        for name in ("finest_um", "edge_um"):
            if not getattr(self, name) > 0:  # also refuses nan
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if self.symmetry < 0 or not (0 <= self.alike <= 1 and self.alike_rad > 0):
            raise ValueError(
                "symmetry must be >= 0, alike in 0..1 and its turn positive, got "
                f"{self.symmetry}, {self.alike}, {self.alike_rad}"
            )

    @property
    def period_rad(self) -> float:
        """Return the smallest rotation that leaves it the same; 0 for what is round."""
        if self.symmetry_broken_by:
            return math.tau
        return math.tau / self.symmetry if self.symmetry else 0.0


def coincide(a: Feature, b: Feature, *, within_um: float) -> bool:
    """Return whether two features of a part are one: of a kind, a position and sizes.

    Sizes that only one of them states do not count. A part has one whole outline,
    about whatever point; outlines of regions go by their names.
    """
    if a.kind == b.kind == "outline":
        return a.region == b.region
    if a.kind != b.kind or math.dist(a.center_um, b.center_um) > within_um:
        return False
    shared = [n for n in _SIZES if n in a.parameters and n in b.parameters]
    same = all(abs(a.parameters[n] - b.parameters[n]) <= within_um for n in shared)
    if a.kind not in ("edge", "pair", "corner"):
        return same
    order = 2 if a.kind == "pair" else 1  # turned by half a turn a pair is the same
    turn = math.remainder(a.angle_rad - b.angle_rad, math.tau / order)
    return same and abs(turn) <= 1e-3


def is_circle_alone(outline: Feature, circle: Feature) -> bool:
    """Return whether a whole outline is one circle and nothing else.

    Its edges are then the circle's own: it would be measured twice.
    """
    if outline.kind != "outline" or circle.kind != "circle" or outline.symmetry != 0:
        return False
    size, radius = outline.parameters["extent_um"], circle.parameters["radius_um"]
    near = _ROUND * radius
    return (
        math.dist(outline.center_um, circle.center_um) <= near
        and abs(size - radius) <= near
        and abs(outline.edge_um - circle.edge_um) <= math.tau * near
    )


def renamed(feature: Feature, name: str) -> Feature:
    """Return the feature under another name."""
    return replace(feature, name=name)
