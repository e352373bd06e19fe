"""Predicted outlines of a plan's targets, as `microplan export --to json` writes them.

Points are in the target's own frame: its origin is the reference point that the look
measures, its axes are the world's at the angle `pose.theta_rad` turned back. y points
up in the image. Every piece runs with the material on its left.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from microplan.schemas.pose import Pose

FORMAT = "microplan-outlines"
VERSION = "1.0"

Polarity = Literal["dark_to_light", "light_to_dark", "unclear"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentEdge:
    """A straight edge."""

    kind: Literal["segment"] = "segment"  # tells the variant
    start_um: tuple[float, float]  # in the target's frame
    end_um: tuple[float, float]  # in the target's frame


@dataclass(frozen=True, slots=True, kw_only=True)
class ArcEdge:
    """A circular edge; the sweep is positive counter-clockwise."""

    kind: Literal["arc"] = "arc"  # tells the variant
    center_um: tuple[float, float]  # in the target's frame
    radius_um: float  # of the circle
    start_rad: float  # of the start, seen from the centre
    sweep_rad: float  # positive counter-clockwise


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgePiece:
    """A stretch of visible edge whose polarity stays the same."""

    body: str  # part, part.post, or tool.left, tool.right
    polarity: Polarity  # crossing the edge out of the material
    contrast: float  # mean step of brightness through the filter, of full scale
    least_contrast: float  # the least along the piece
    closed: bool  # whether its end is its start
    edges: tuple[SegmentEdge | ArcEdge, ...]  # each begins where the last one ends


@dataclass(frozen=True, slots=True, kw_only=True)
class LookOutlines:
    """What of one look's target is seen, and how."""

    look: str  # its id in the plan
    step: str  # id of the step that looks
    target: str  # what is looked for
    pose: Pose  # of the target's frame in the world
    column_px: float  # where the image shows the origin; 0: middle of the left column
    row_px: float  # the same downwards; 0: middle of the top row
    um_per_px: float  # scale of the image
    magnification: float  # of the look
    focus_um: float  # world height in focus
    light: float  # level of the lamp, 0 to 1
    image: str  # path in the plan folder
    image_sha256: str  # of its pixels
    filter_px: float  # standard deviation of the edge filter
    length_um: float  # of all of the target's edges
    hidden_um: float  # of that covered by higher bodies
    outside_um: float  # of that out of the frame, or too near to its border
    pieces: tuple[EdgePiece, ...]  # what of its edges is seen


@dataclass(frozen=True, slots=True, kw_only=True)
class Outlines:
    """All looks of a plan that were asked for, in its order."""

    format: Literal["microplan-outlines"] = "microplan-outlines"  # what the file is
    version: str = VERSION  # major.minor of the format
    plan: str  # its name
    status: Literal["feasible", "infeasible"]  # of the plan
    simulated: bool = True  # everything here is predicted, nothing was measured
    looks: tuple[LookOutlines, ...]  # in the plan's order
