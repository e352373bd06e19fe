"""Settings of a look in the plan: zooms, focus stops, times, solids that hide.

Added in format 2.2: a plan without them is read as one of which they are unknown.
Lengths are um in object space, heights are of the world. A pair is an interval.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

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


ZoomReason = Literal["workcell", "finest detail", "field", "useful ceiling", "trials"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoomBound:
    """A magnification that a look may not go below or beyond, and why."""

    end: Literal["least", "most"]  # which end of the range
    magnification: float  # the bound
    by: ZoomReason  # what bounds it
    reason: str  # with its numbers


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoomTried:
    """A magnification at which the trials were not good enough."""

    magnification: float  # that was tried
    reason: str  # what the trials missed


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoomLimits:
    """The magnifications that a look allows, in closed form."""

    least: float  # smallest magnification
    most: float  # largest magnification
    bounds: tuple[ZoomBound, ...]  # what bounds either end
    refused: tuple[ZoomTried, ...] = ()  # in the order they were tried


@dataclass(frozen=True, slots=True, kw_only=True)
class ApertureRow:
    """What the microscope is at one of the magnifications that are tried."""

    magnification: float  # one that is tried
    aperture: float  # numerical, object side
    um_per_px: float  # in object space
    cutoff_um: float  # shortest period that the lens passes, wavelength / (2 A)
    depth_um: float  # depth of field, n wavelength / A**2, from end to end
    field_um: tuple[float, float]  # width, height
    chosen: bool  # whether the look uses it


@dataclass(frozen=True, slots=True, kw_only=True)
class FocusAccepted:
    """Focus heights at which the trials still measured a feature, at its own height."""

    feature: str  # which feature
    least_um: float  # lowest
    most_um: float  # highest


@dataclass(frozen=True, slots=True, kw_only=True)
class FocusCover:
    """Which heights of the target the focus and its further stops take in."""

    accepted: tuple[FocusAccepted, ...]  # by feature
    sigma_um: float  # of the target's height
    margin_um: float  # kept from the ends of what is accepted
    covered_um: tuple[float, float]  # errors of the height, at least one stop sharp
    stops: int  # the first included


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeRow:
    """One thing that a look waits for."""

    what: str  # what is waited for
    time_s: float  # how long


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewChange:
    """What it takes to look after the look before, if all goes as planned."""

    since: str | None  # look before; None: the first sets everything
    parcentric_sigma_um: float  # jump of the image, per axis; 0 if the zoom stays
    focus_um: float | None  # way of the focus; None: from where is not known
    lateral_sigma_um: float  # shift of the image over that way, per axis
    times: tuple[TimeRow, ...]  # in order
    total_s: float  # of all of them


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewVerdict:
    """Why a look is set as it is, and what that costs."""

    zoom: ZoomLimits  # magnifications that are allowed
    apertures: tuple[ApertureRow, ...]  # by magnification
    focus: FocusCover  # heights that are covered
    change: ViewChange | None = None  # since the look before; None: not known


@dataclass(frozen=True, slots=True, kw_only=True)
class CoarseFirst:
    """What comes before a fine look: a coarse one, and moves that centre the target.

    The axes bring the target to where the fine look has it, and go back afterwards.
    """

    look: str  # id, of the same step
    axes: Literal["stage", "robot"]  # what moves
    at_um: tuple[float, float]  # world place of the target for the fine look
    most_um: float  # a longer way is a fault
