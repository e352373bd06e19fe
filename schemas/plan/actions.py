"""Actions of a step, seven variants distinguished by `kind`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

AxesName = Literal["stage", "robot"]


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisMove:
    """Absolute targets of one axis group, moved together; None leaves an axis."""

    axes: AxesName  # which group moves
    x_um: float | None = None  # reading to go to
    y_um: float | None = None  # reading to go to
    z_um: float | None = None  # reading to go to
    theta_rad: float | None = None  # reading to go to
    speed_um_per_s: float | None = None  # None: the axes' own speed


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightSearch:
    """Focus sweep over a face: where its image is sharpest is its height."""

    look: str  # id of the look whose view and region it uses
    expected_um: float  # world height of the face if seated
    within_um: float  # how far off still counts as seated
    focus_um: tuple[float, ...]  # stops
    ring_radius_um: float  # the score is taken on edges about this radius; 0: all
    # peak less height, by the stated wavefront: taken off the peak; added after 2.7
    bias_um: float = 0.0
    # of 95 %, by what is not known of that: in sigma; added after 2.7
    bias_half_width_um: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LocateAction:
    """Measure `target` and remember where it is."""

    kind: Literal["locate"] = "locate"  # which action
    target: str  # what is measured
    look: str  # id of the look


@dataclass(frozen=True, slots=True, kw_only=True)
class AlignAction:
    """Move `axes` until `target` is at `to`, looking after every move."""

    kind: Literal["align"] = "align"  # which action
    target: str  # what is measured and brought
    to: str  # where it is brought
    look: str  # id of the look
    axes: AxesName  # what moves
    path: tuple[
        str, ...
    ]  # order of the first approach: ("xy",), ("x", "y"), ("y", "x")


@dataclass(frozen=True, slots=True, kw_only=True)
class RestAngle:
    """How a part may lie flat between jaws."""

    theta_rad: float  # of the part in the tool's frame, 0 to 2 pi
    across_um: float  # as that of the action, there


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspAction:
    """Close the jaws of `tool` on `target`."""

    kind: Literal["grasp"] = "grasp"  # which action
    target: str  # what is gripped
    tool: str  # with what
    opening_um: float  # of the jaws at the end
    across_um: float = 0.0  # of the part's origin, from the middle of the closed jaws
    rests: tuple[RestAngle, ...] = ()  # added after 2.5; (): it keeps its angle


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveAction:
    """Nothing beyond the step's moves."""

    kind: Literal["move"] = "move"  # which action


@dataclass(frozen=True, slots=True, kw_only=True)
class InsertAction:
    """Put `target` onto `onto` by `moves`; no sensor tells whether it seated."""

    kind: Literal["insert"] = "insert"  # which action
    target: str  # the hole, or its part
    onto: str  # the post
    moves: tuple[AxisMove, ...]  # in order


@dataclass(frozen=True, slots=True, kw_only=True)
class ReleaseAction:
    """Open the jaws of `tool`."""

    kind: Literal["release"] = "release"  # which action
    target: str  # what is let go
    tool: str  # that holds it
    opening_um: float  # of the jaws at the end


@dataclass(frozen=True, slots=True, kw_only=True)
class VerifyAction:
    """Decide whether `target` sits on `on`; every part of it can fail."""

    kind: Literal["verify"] = "verify"  # which action
    target: str  # what should sit
    on: str  # its seat
    look: str  # sees the target
    seat_look: str  # sees what it should sit on
    within_um: float  # how far off still counts as seated
    height: HeightSearch | None  # None: the height is not looked at
    empty: str | None  # tool that must hold nothing
    within_rad: float | None = None  # turned against the seat; None: any angle


Action = (
    LocateAction
    | AlignAction
    | GraspAction
    | MoveAction
    | InsertAction
    | ReleaseAction
    | VerifyAction
)
