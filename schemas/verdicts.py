"""What the plan says of fit, budget, grasp, release and method: frozen types.

Added after format 2.0: a plan without them is read as one whose verdicts are unknown.
Lengths are um, angles rad, forces uN. A pair of numbers is an interval.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

FitClass = Literal["clearance", "transition", "interference"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FitVerdict:
    """How a round hole and a round shaft go together over their tolerances.

    Triples are least, drawn, greatest; the least counts taper against the fit.
    """

    hole_um: float  # diameter as drawn
    shaft_um: float
    fit: FitClass
    clearance_um: tuple[float, float, float]  # difference of the diameters
    capture_um: tuple[float, float, float]  # sideways error that still goes in
    taper_um: float  # what leaning walls may take of the clearance
    engaged_um: float  # overlap in height once inserted
    tilt_limit_rad: float | None  # least clearance over that; None: nothing engaged
    tilt_rad: float  # of the axes, 3 sigma; how the part sits in the jaws is unknown
    tilt_takes_um: float  # of the clearance, over the engaged length
    wedging_rad: float | None  # below this tilt it cannot wedge; None: no friction
    wedging_depth_um: float  # from here on geometry keeps the tilt below that
    may_wedge: bool
