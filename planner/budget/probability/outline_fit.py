"""A fit by outlines with its sizes as fabricated, and the error of a pose."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from microplan.planner.assembly.fits.peg_in_hole import PegInHole, Size
from microplan.planner.assembly.fits.room import capture_um
from microplan.planner.budget.probability.angle_budget import AngleError
from microplan.planner.budget.probability.fit_probability import RoundFit
from microplan.planner.budget.probability.polygon_mass import PlaneError

# Gauss nodes over each tolerance, by the power with which a rare outcome changes.
SIZES = ((1.0, 3), (3.0, 4), (10.0, 6), (math.inf, 8))  # power: nodes a side
CLOSE = 1e-4  # accuracy of P over the angle, as a share of the rarer outcome
LEFT_COUNTS = 0.5  # share of a cut-off residual's sigma that smooths like a normal one


@dataclass(frozen=True, slots=True, kw_only=True)
class OutlineFit:
    """A planar peg and hole, edges as drawn, with what fabrication adds."""

    shape: PegInHole
    hole_tolerance_um: float  # hard limit of the edge's error, uniform within
    shaft_tolerance_um: float
    taper_um: float = 0.0  # what leaning walls take on each side
    wider_um: float = 0.0  # by which the hole's edge is farther out than drawn
    close: float = CLOSE  # how closely P is found over the angle

    @property
    def capture_um(self) -> float:
        """Return the largest sideways error that still goes in, sizes as drawn."""
        return capture_um(self.shape, self.wider_um - self.taper_um)

    @property
    def inscribed(self) -> RoundFit:
        """Return the round fit that always goes in where this one does not turn."""
        return RoundFit(
            hole_um=self.capture_um,
            shaft_um=0.0,
            hole_tolerance_um=self.hole_tolerance_um,
            shaft_tolerance_um=self.shaft_tolerance_um,
        )

    def scaled(self, factor: float) -> OutlineFit:
        """Return the same fit with other tolerances."""
        return replace(
            self,
            hole_tolerance_um=self.hole_tolerance_um * factor,
            shaft_tolerance_um=self.shaft_tolerance_um * factor,
        )

    def widened(self, wider_um: float) -> OutlineFit:
        """Return the same fit with the hole's edge farther out."""
        return replace(self, wider_um=self.wider_um + wider_um)

    def sizes(self, error: PoseError) -> list[Size]:
        """Return sizes as fabricated, as many as the error asks for.

        Across a tolerance t a rare outcome changes by the power of t times capture
        radius over the least variance.
        """
        tolerance = max(self.hole_tolerance_um, self.shaft_tolerance_um)
        rest, left = error.plane.rest.principal[0], error.plane.residual.sigma_um
        square = max(rest**2, (LEFT_COUNTS * left) ** 2, 1e-12)
        power = tolerance * max(self.capture_um, tolerance) / square
        count = next(nodes for most, nodes in SIZES if power <= most)
        base = self.wider_um - self.taper_um
        return [
            Size(hole_um=base + hole, peg_um=peg, weight=a * b)
            for hole, a in _uniform(self.hole_tolerance_um, count)
            for peg, b in _uniform(self.shaft_tolerance_um, count)
        ]


def _uniform(tolerance_um: float, count: int) -> list[tuple[float, float]]:
    """Return nodes and weights of a uniform distribution within a tolerance."""
    if tolerance_um <= 0:
        return [(0.0, 1.0)]
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return list(
        zip((tolerance_um * nodes).tolist(), (weights / 2).tolist(), strict=True)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseError:
    """Error of a peg's pose in the frame of its hole."""

    plane: PlaneError  # of the place, at no error of the angle
    angle: AngleError
    # what an error of the angle moves the place by, um per rad
    lever_um: tuple[float, float] = (0.0, 0.0)
    middle_rad: float = 0.0  # of the angle
