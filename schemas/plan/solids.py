"""The room that parts and fingers take up, as the plan tells it: convex prisms."""

from __future__ import annotations

from dataclasses import dataclass

from microplan.arrays import Point

MOST_CORNERS = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Prism:
    """A convex polygon times a range of heights; what it stands for lies inside."""

    corners_um: tuple[Point, ...]  # counter-clockwise, in the owner's frame
    low_um: float  # above the owner's underside
    high_um: float  # above the owner's underside

    def __post_init__(self) -> None:
        if len(self.corners_um) < 3:
            raise ValueError(f"a prism has 3 corners at least, {self.corners_um}")
        if not self.high_um >= self.low_um:
            raise ValueError(f"heights must rise, got {self.low_um}..{self.high_um}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Solid:
    """A part: a prism for its plate and one for each post."""

    name: str  # the part's
    prisms: tuple[Prism, ...]  # the plate first


@dataclass(frozen=True, slots=True, kw_only=True)
class Fingers:
    """A tool's two fingers in the frame of its grip, the jaws closed.

    An opening of w shifts the left one by -w / 2 along x, the right one by w / 2.
    """

    tool: str  # its name
    left: Prism  # opens to -x
    right: Prism  # opens to +x
