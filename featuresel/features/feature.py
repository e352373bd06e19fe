"""A feature of a part: what a look can aim at, in the part's frame."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from microplan.arrays import Point
from microplan.featuresel.routines.contract import TargetKind

# what tells two features of one kind and place apart
_SIZES = ("radius_um", "outer_um", "extent_um", "length_um", "width_um", "reach_um")


@dataclass(frozen=True, slots=True, kw_only=True)
class Feature:
    """Part of an outline that a routine can find; parameters as in `Target`."""

    name: str
    kind: TargetKind
    center_um: Point  # reference point in the part's frame
    angle_rad: float = 0.0  # of the feature's frame in the part's
    parameters: Mapping[str, float] = field(default_factory=dict)
    symmetry: int = 1  # order of the rotational symmetry; 1 = none, 0 = any turn
    symmetry_broken_by: str = ""
    finest_um: float  # smallest detail that a routine needs resolved
    bright: bool  # brighter than what surrounds it, if the part is
    edge_um: float  # length of the drawn edges it is made of: what tells its place
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
        """Return the smallest turn that leaves it the same; 0 for what is round."""
        if self.symmetry_broken_by:
            return math.tau
        return math.tau / self.symmetry if self.symmetry else 0.0


def coincide(a: Feature, b: Feature, *, within_um: float) -> bool:
    """Return whether two features of a part are one: of a kind, a place and sizes.

    Sizes that only one of them states do not count. A part has one whole outline,
    about whatever point.
    """
    if a.kind == b.kind == "outline":
        return True
    if a.kind != b.kind or math.dist(a.center_um, b.center_um) > within_um:
        return False
    shared = [n for n in _SIZES if n in a.parameters and n in b.parameters]
    same = all(abs(a.parameters[n] - b.parameters[n]) <= within_um for n in shared)
    if a.kind not in ("edge", "pair", "corner"):
        return same
    order = 2 if a.kind == "pair" else 1  # turned by half a turn a pair is the same
    turn = math.remainder(a.angle_rad - b.angle_rad, math.tau / order)
    return same and abs(turn) <= 1e-3


def renamed(feature: Feature, name: str) -> Feature:
    """Return the feature under another name."""
    return replace(feature, name=name)
