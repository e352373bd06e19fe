"""Proposed features, as routines find them: from the drawing to the part's pose."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from featuresel.candidates import chains
from featuresel.case import LookCase
from featuresel.feature import Feature, to_target
from featuresel.features import propose
from featuresel.located import Located, along, located
from featuresel.nominal import nominal_render
from featuresel.routines import Artifact, Measurement
from featuresel.routines.chain import measure_chain
from featuresel.trials import prepare, start

Look = Callable[[str], LookCase]

DX_UM, DY_UM, TURN_RAD = 0.9, -0.7, 0.01


def aimed(case: LookCase, feature: Feature) -> LookCase:
    """Return the look with one feature of its part as the target."""
    outline = case.moving[0].outline
    column, row = case.frame.to_pixel(case.x_um, case.y_um)
    target = to_target(
        feature, about_um=(0.0, 0.0), column=column, row=row, theta_rad=case.theta_rad,
        px_per_um=case.microscope.px_per_um, search_px=3.0, theta_range_rad=0.05,
        outline=outline,
    )  # fmt: skip
    return replace(case, target=target, theta_any=False)


@pytest.mark.parametrize(
    ("kind", "routine"),
    [
        ("corner", "corner"),
        ("edge", "line_caliper"),
        ("pair", "edge_pair"),
        ("circle", "circle_caliper"),
        ("outline", "contour_match"),
    ],
)
def test_a_proposed_feature_tells_the_parts_pose(
    kind: str, routine: str, look: Look
) -> None:
    bracket = look("bracket")
    found = [f for f in propose(bracket.moving[0].outline) if f.kind == kind]
    assert found
    for feature in found[:2]:
        case = aimed(bracket, feature)
        assert (routine,) in chains(case.target)
        image = nominal_render(case)(dx_um=DX_UM, dy_um=DY_UM, theta_rad=TURN_RAD)
        artifact = prepare(case, [(routine,)]).artifacts[routine]
        assert isinstance(artifact, Artifact), artifact
        said = measure_chain(image, [(routine, artifact)], start(case))
        assert isinstance(said, Measurement), said
        place = located(case, said)
        assert isinstance(place, Located)
        # a fiftieth of a pixel: what sub-pixel positions of edges err by without noise
        assert error_um(case, place) < 0.02 * case.microscope.um_per_px, feature


def error_um(case: LookCase, place: Located) -> float:
    """Return how far the place is off, in the directions that are known.

    Where no angle was measured, the nominal one has put the part on the other side of
    the feature by as much as the arm has turned.
    """
    x, y = place.x_um - case.x_um - DX_UM, place.y_um - case.y_um - DY_UM
    if place.theta_rad is None:
        was, now = (
            cmath.rect(1.0, turn) * complex(*case.target.offset_um)
            for turn in (case.theta_rad, case.theta_rad + TURN_RAD)
        )
        x, y = x - (now - was).real, y - (now - was).imag
    else:
        turn = place.theta_rad - case.theta_rad - TURN_RAD
        assert abs(math.remainder(turn, math.tau)) < 1e-3
    return math.hypot(*along((x, y), place.axis_rad))
