"""Mating of a hole with a shaft: class of fit, capture radius, tilt, wedging.

Pure geometry over the tolerances; how likely the parts find each other is for
`planner.budget`. Whole circles have closed forms, other outlines slices. Edges are off
by at most the profile tolerance, walls lean by at most the taper: in which direction is
not known, so each takes from the clearance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely

from microplan.planner.assembly.assembly import State, locate_place, owner_of, part_z_um
from microplan.planner.assembly.fits.mates import mates_of, shape_of
from microplan.planner.assembly.fits.peg_in_hole import PegInHole
from microplan.planner.assembly.fits.room import (
    capture_um,
    clearance_um,
    free_angles_rad,
    overlap_of,
)
from microplan.planner.assembly.shapes import hull
from microplan.planner.task.task import PartFeature, Post, Task, TaskStep
from microplan.schemas.plan.verdicts import FitClass, FitVerdict, OutlineFitVerdict

# A corner of a hull within this of a jaw touches it: fabricated edges vary by more.
TOUCH_UM = 0.05
# What touches by one corner is taken as this wide: fabricated corners are round.
LEAST_WIDTH_UM = 0.1


def contact_um2(task: Task, state: State, name: str) -> float:
    """Return the area over which a held part faces one finger, the larger of both.

    The length of its hull that lies flat against a jaw, times the height that part and
    finger share.
    """
    part, held = task.parts[name], state.parts[name]
    tool = task.workcell.tools[state.tool or ""]
    turned = shapely.affinity.rotate(
        hull(part.outline), held.pose.theta_rad, origin=(0, 0), use_radians=True
    )
    points = shapely.get_coordinates(turned)
    width = max(_flat_um(points * side) for side in (1.0, -1.0))
    low = max(held.z_um, 0.0)
    high = min(held.z_um + part.thickness_um, tool.thickness_um)
    return max(width, LEAST_WIDTH_UM) * max(high - low, LEAST_WIDTH_UM)


def _flat_um(points: np.ndarray) -> float:
    """Return how much of y lies within TOUCH_UM of the greatest x."""
    touching = points[points[:, 0] > points[:, 0].max() - TOUCH_UM, 1]
    return float(np.ptp(touching))


# Tilts of the axes are taken at this many sigmas where a limit must hold.
TILT_SIGMAS = 3.0
PER_TAPER_UM = 100.0  # `taper_um_per_100um`
SAME_UM = 1e-9  # sizes closer than this are equal


@dataclass(frozen=True, slots=True, kw_only=True)
class Mating:
    """A hole over a shaft; widths are diameters of circles on or around them."""

    hole_um: float
    shaft_um: float
    tolerance_um: float  # of the clearance: both edges of both parts
    taper_um: float  # what leaning walls may take of the clearance
    engaged_um: float  # length along which hole and shaft overlap at the end
    friction: float
    shape: PegInHole | None = None  # None: both are whole circles

    @property
    def clearance_um(self) -> tuple[float, float, float]:
        """Return the least, drawn and greatest difference of the diameters.

        Of other outlines than circles: by how much the shaft could be wider all round.
        """
        drawn = self.hole_um - self.shaft_um
        if self.shape is not None:
            least, drawn, most = (
                clearance_um(self.shape, wider) for wider in self.wider_um
            )
            return least, drawn, most
        return (
            drawn - self.tolerance_um - self.taper_um,
            drawn,
            drawn + self.tolerance_um,
        )

    @property
    def capture_um(self) -> tuple[float, float, float]:
        """Return the sideways error that still goes in: least, drawn, greatest."""
        if self.shape is not None:
            least, drawn, most = (
                capture_um(self.shape, wider) for wider in self.wider_um
            )
        else:
            least, drawn, most = (max(c, 0) / 2 for c in self.clearance_um)
        return least, drawn, most

    @property
    def wider_um(self) -> tuple[float, float, float]:
        """Return how much farther out the hole's edge is than drawn: least to most."""
        half = self.tolerance_um / 2
        return (-half - self.taper_um / 2, 0.0, half)

    @property
    def fit_class(self) -> FitClass:
        """Return whether all, some or none of the parts as fabricated go together.

        The terms of ISO 286-1:2010, over the whole range of sizes.
        """
        least, _, most = self.clearance_um
        if least > SAME_UM:
            return "clearance"
        return "transition" if most > SAME_UM else "interference"

    def tilt_limit_rad(self, clearance_um: float) -> float | None:
        """Return the tilt at which the shaft touches both ends of the hole.

        c / L for small angles, None where nothing is engaged yet.
        """
        if self.engaged_um <= 0:
            return None
        return max(clearance_um, 0.0) / self.engaged_um

    def wedging_rad(self, clearance_um: float) -> float | None:
        """Return the tilt below which two-point contact cannot wedge.

        (c / D) / mu, None without friction. Two contacts hold a part by themselves
        only if the line between them lies in both friction cones: its slope over the
        hole's width, depth / D, must be below mu. Tilted by t, a shaft touches both
        sides at a depth of c / t. The exact slope is (c / D - (1 - cos t)) / sin t, and
        one cone is rotated by t: both only raise the limit.

        References
        ----------
        Whitney (1982), Quasi-static assembly of compliantly supported rigid parts, J.
        Dyn. Syst. Meas. Control 104, 65-77: the conditions of geometry and force.
        """
        if self.friction <= 0:
            return None
        return max(clearance_um, 0.0) / self.hole_um / self.friction

    def may_wedge(self, clearance_um: float, tilt_rad: float) -> bool:
        """Return whether a tilt brings two-point contact that may hold by itself.

        Below the tilt limit a hole shorter than the wedging depth is never touched on
        both sides.
        """
        limits = self.wedging_rad(clearance_um), self.tilt_limit_rad(clearance_um)
        return all(limit is not None and tilt_rad >= limit for limit in limits)

    @property
    def wedging_depth_um(self) -> float:
        """Return how deep the shaft must be for geometry alone to rule out wedging.

        c / l falls below (c / D) / mu where l > mu D.
        """
        return self.friction * self.hole_um


def mating_of(task: Task, step: TaskStep, after: State) -> Mating | None:
    """Return how the parts of an insertion mate, None if hole or post is unclear."""
    feature, post = hole_and_shaft(task, step)
    if feature is None or post is None:
        return None
    mates = mates_of(task.parts[owner_of(step.target or "")], feature, post)
    if not mates.are_clear:
        return None
    hole_part, shaft_part = owner_of(step.target or ""), owner_of(step.onto or "")
    engaged_um = _engaged_um(task, after, hole_part, shaft_part, post)
    lean = sum(task.parts[n].taper_um_per_100um for n in (hole_part, shaft_part))
    angles = (
        locate_place(task, after, name).pose.theta_rad
        for name in (shaft_part, hole_part)
    )
    angle_rad = math.remainder(next(angles) - next(angles), math.tau)
    edges_um = task.parts[hole_part].profile_tolerance_um + post.profile_tolerance_um
    return Mating(
        hole_um=2 * feature.radius_um,
        shaft_um=2 * post.radius_um,
        tolerance_um=2 * edges_um,
        taper_um=2 * lean * engaged_um / PER_TAPER_UM,
        engaged_um=engaged_um,
        friction=task.environment.friction,
        shape=None if mates.are_round else shape_of(mates, feature, post, angle_rad),
    )


def hole_and_shaft(
    task: Task, step: TaskStep
) -> tuple[PartFeature | None, Post | None]:
    """Return the feature and the post of an insertion, None for what is neither."""
    hole_part, _, hole = (step.target or "").partition(".")
    shaft_part, _, shaft = (step.onto or "").partition(".")
    feature = task.parts[hole_part].features.get(hole)
    return feature, task.parts[shaft_part].posts.get(shaft)


def _engaged_um(task: Task, after: State, hole: str, owner: str, post: Post) -> float:
    """Return the overlap in height of a part and a post once the moves are done."""
    low = part_z_um(task, after, hole)
    foot = part_z_um(task, after, owner) + task.parts[owner].thickness_um
    top = min(low + task.parts[hole].thickness_um, foot + post.height_um)
    return max(top - max(low, foot), 0.0)


def fit_verdict(mating: Mating, tilt_sigma_rad: float) -> FitVerdict:
    """Return what the plan says of a fit.

    `tilt_sigma_rad` is what the workcell states of the axes; how the part sits in the
    jaws adds to it and is not known.
    """
    least, drawn, most = mating.clearance_um
    tilt = TILT_SIGMAS * tilt_sigma_rad
    return FitVerdict(
        hole_um=mating.hole_um,
        shaft_um=mating.shaft_um,
        fit=mating.fit_class,
        clearance_um=(least, drawn, most),
        capture_um=mating.capture_um,
        taper_um=mating.taper_um,
        engaged_um=mating.engaged_um,
        tilt_limit_rad=mating.tilt_limit_rad(least),
        tilt_rad=tilt,
        tilt_takes_um=mating.engaged_um * math.tan(tilt),
        wedging_rad=mating.wedging_rad(least),
        wedging_depth_um=mating.wedging_depth_um,
        may_wedge=mating.may_wedge(least, tilt),
        outline=None if mating.shape is None else _outline_verdict(mating),
    )


def _outline_verdict(mating: Mating) -> OutlineFitVerdict:
    """Return what the plan says of a fit of other outlines than circles."""
    if mating.shape is None:
        raise ValueError("a round fit has no outlines")
    least, drawn, most = (
        free_angles_rad(mating.shape, wider) for wider in mating.wider_um
    )
    overlap = overlap_of(mating.shape)
    return OutlineFitVerdict(
        angle_rad=mating.shape.angle_rad,
        turns_freely=mating.shape.turns_freely,
        theta_rad=(least, drawn, most),
        overlap_um=0.0 if overlap is None else overlap.depth_um,
    )


def fit_words(step: str, found: FitVerdict) -> str:
    """Return a fit in words, every number with its unit."""
    least, drawn, most = found.clearance_um
    words = (
        f"step {step!r}: {found.fit} fit, {found.hole_um:.4g} um over "
        f"{found.shaft_um:.4g} um: clearance {least:.3g}..{most:.3g} um, drawn "
        f"{drawn:.3g} um; the hole finds any shaft up to {found.capture_um[0]:.3g} um "
        "off (the least capture radius)"
    )
    if found.outline is not None and not found.outline.turns_freely:
        back, forth = (1e3 * angle for angle in found.outline.theta_rad[0])
        words += f" and turned by {back:.3g}..{forth:.3g} mrad"
    if found.tilt_limit_rad is None:
        return words + "; nothing is engaged once the moves are done"
    words += f" that leans up to {1e3 * found.tilt_limit_rad:.3g} mrad where it is "
    words += f"{found.engaged_um:.4g} um deep"
    if found.wedging_rad is None:
        return words + "; no friction, no wedging"
    return words + f"; it cannot wedge below {1e3 * found.wedging_rad:.3g} mrad"
