"""Predicted outlines of a plan's targets, as `microplan export --to json` writes them.

Points are in the target's own frame: its origin is the reference point that the look
measures, its axes are the world's at the angle `pose.theta_rad` turned back. y points
up in the image. Every piece runs with the material on its left.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from schemas.pose import Pose

FORMAT = "microplan-outlines"
VERSION = "1.0"

Polarity = Literal["dark_to_light", "light_to_dark", "unclear"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentEdge:
    """A straight edge."""

    kind: Literal["segment"] = "segment"
    start_um: tuple[float, float]
    end_um: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class ArcEdge:
    """A circular edge; the sweep is positive counter-clockwise."""

    kind: Literal["arc"] = "arc"
    center_um: tuple[float, float]
    radius_um: float
    start_rad: float
    sweep_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgePiece:
    """A stretch of visible edge whose polarity stays the same."""

    body: str  # part, part.post, or tool.left, tool.right
    polarity: Polarity  # crossing the edge out of the material
    contrast: float  # mean step of brightness through the filter, of full scale
    least_contrast: float  # the least along the piece
    closed: bool
    edges: tuple[SegmentEdge | ArcEdge, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class LookOutlines:
    """What of one look's target is seen, and how."""

    look: str
    step: str
    target: str
    pose: Pose  # of the target's frame in the world
    column_px: float  # where the image shows the origin: (0, 0) is the middle of the
    row_px: float  # top left pixel, rows go down
    um_per_px: float
    magnification: float
    focus_um: float
    light: float
    image: str  # path in the plan folder
    image_sha256: str  # of its pixels
    filter_px: float  # standard deviation of the edge filter
    length_um: float  # of all of the target's edges
    hidden_um: float  # of that covered by higher bodies
    outside_um: float  # of that out of the frame, or too near to its border
    pieces: tuple[EdgePiece, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Outlines:
    """All looks of a plan that were asked for, in its order."""

    format: Literal["microplan-outlines"] = "microplan-outlines"
    version: str = VERSION
    plan: str
    status: Literal["feasible", "infeasible"]
    simulated: bool = True  # everything here is predicted, nothing was measured
    looks: tuple[LookOutlines, ...]
