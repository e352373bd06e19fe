"""Proposed features, as routines find them: from the drawing to the part's pose."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from featuresel.candidates import Chain, chains
from featuresel.case import LookCase
from featuresel.completeness import seen_share
from featuresel.feature import Feature, to_target
from featuresel.feature_set import choose_set
from featuresel.features import propose
from featuresel.located import Located, along, located
from featuresel.nominal import nominal_render
from featuresel.perturb import design
from featuresel.pick import Option, pick
from featuresel.pose_need import Need
from featuresel.routines import Artifact, Measurement
from featuresel.routines.chain import measure_chain
from featuresel.score import score
from featuresel.select import select
from featuresel.sights import sight_of
from featuresel.trials import prepare, run, start
from optics.outline import Outline
from optics.scene import Layer
from tests.featuresel.conftest import disc, gear, polygon

Look = Callable[[str], LookCase]

RIM = ("circle_caliper", "tooth_notch")
DX_UM, DY_UM, TURN_RAD = 0.9, -0.7, 0.01


def aimed(case: LookCase, feature: Feature, theta_range_rad: float) -> LookCase:
    """Return the look with one feature of its part as the target."""
    outline = case.moving[0].outline
    column, row = case.frame.to_pixel(case.x_um, case.y_um)
    target = to_target(
        feature, about_um=(0.0, 0.0), column=column, row=row, theta_rad=case.theta_rad,
        px_per_um=case.microscope.px_per_um, search_px=3.0,
        theta_range_rad=theta_range_rad, outline=outline,
    )  # fmt: skip
    return replace(case, target=target, theta_any=theta_range_rad == math.pi)


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
        case = aimed(bracket, feature, 0.05)
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


def long_tooth_gear() -> Outline:
    """Return the gear with a notched bore and one tooth that is 25 um longer."""
    points = []
    for k in range(18):
        tip = 75.0 if k == 9 else 50.0
        for radius, angle in ((tip, -4), (tip, 4), (45, 6), (45, 14)):
            turn = math.radians(20 * k + angle)
            points.append((radius * math.cos(turn), radius * math.sin(turn)))
    return Outline(rings=(polygon(*points), *gear().rings[1:]))


def over_the_notch() -> Layer:
    """Return a washer that stands over the notch, whatever the angle."""
    outline = Outline(rings=(disc(40), disc(15).reversed()))
    return Layer(name="washer", outline=outline, z_um=5.0, reflectance=0.5)


def tried(case: LookCase, feature: Feature, chain: Chain) -> Option:
    """Return a feature as an option, after trials of one chain."""
    look = aimed(case, feature, math.pi)
    ready = prepare(look, [chain])
    done = run(look, ready, design(look, 10, 1))
    return Option(
        target=look.target,
        scores=score(look, ready, done),
        visible=seen_share(look.target, nominal_render(look).veil()),
    )


def test_another_feature_is_picked_when_the_notch_is_hidden(look: Look) -> None:
    outline = long_tooth_gear()
    layer = Layer(name="gear", outline=outline, z_um=0.0, reflectance=0.8)
    case = look("find_gear")
    calm = replace(case.spread, pose_sigma_xy_um=0.5, search_um=2.0)
    free = replace(case, moving=(layer,), spread=calm, tolerance_theta_rad=0.01)
    hidden = replace(free, static=(over_the_notch(),))
    features = {f.kind: f for f in propose(outline)}
    ways = ((features["teeth"], RIM), (features["outline"], ("contour_match",)))
    found = []
    for shown in (free, hidden):
        options = [tried(shown, feature, chain) for feature, chain in ways]
        found.append(pick(options, tolerance_um=1.0, tolerance_theta_rad=0.01))
    assert [f.name for f in found] == ["teeth1", "outline1"]
    assert "no chain is reliable" in dict(found[1].reasons)["teeth1"]


def test_two_edges_tell_the_pose_that_neither_tells(look: Look) -> None:
    bracket = look("bracket")
    calm = replace(bracket.spread, pose_sigma_theta_rad=0.01, search_um=2.0)
    bracket = replace(bracket, spread=calm)
    sights = []
    for feature in propose(bracket.moving[0].outline):
        if feature.name in ("edge1", "edge2"):
            case = aimed(bracket, feature, 0.05)
            ready = prepare(case, [("line_caliper",)])
            (seen,) = score(case, ready, run(case, ready, design(case, 6, 1)))
            assert seen.axis_rad is not None
            across = seen.axis_rad - feature.angle_rad  # both in the part's frame
            assert abs(math.remainder(across, math.pi)) < 1e-2
            alone = select(
                [seen], tolerance_um=1.0, tolerance_theta_rad=None, in_set=True
            )
            assert alone.chosen == seen
            sights.append(
                sight_of(feature, seen, about_um=(0, 0), theta_rad=case.theta_rad)
            )
    need = Need(
        sigma_um=0.5, sigma_theta_rad=0.01, radius_um=80.0, redundant=False, most=2
    )
    found = choose_set(sights, need)
    assert found.qualifies
    assert sorted(found.names) == ["edge1", "edge2"]
    assert math.isinf(found.dropped_um)
