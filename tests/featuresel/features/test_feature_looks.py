"""Proposed features, as routines find them: from the drawing to places and sets."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from microplan.featuresel.features.feature import Feature
from microplan.featuresel.features.features import propose
from microplan.featuresel.look.design import design
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.templates import Located, along, located
from microplan.featuresel.routines.chain import measure_chain
from microplan.featuresel.routines.contract import Artifact, Measurement
from microplan.featuresel.selection.constraints import Constraints
from microplan.featuresel.selection.evaluate import visible_share
from microplan.featuresel.selection.select import select
from microplan.featuresel.sets.feature_set import choose_set
from microplan.featuresel.sets.pose_covariance import (
    FeatureMeasurement,
    PoseRequirement,
    measurement_of,
)
from microplan.featuresel.trials.chains import Chain, chains
from microplan.featuresel.trials.score import score
from microplan.featuresel.trials.trials import prepare, run, start
from microplan.optics.outline.outline import Outline
from microplan.optics.render.scene import Layer
from tests.featuresel.aims import aimed
from tests.featuresel.conftest import disc, gear, polygon

Look = Callable[[str], LookCase]

RIM = ("circle_caliper", "tooth_notch")
DX_UM, DY_UM, TURN_RAD = 0.9, -0.7, 0.01


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
def test_a_proposed_feature_tells_its_place_and_the_parts_angle(
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
    """Return how far the feature is off, in the directions that are known."""
    x, y = place.x_um - case.x_um - DX_UM, place.y_um - case.y_um - DY_UM
    if place.theta_rad is not None:
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


def sight(case: LookCase, feature: Feature, chain: Chain) -> FeatureMeasurement | str:
    """Return a feature as a set may have it after trials, or why it may not."""
    aim = aimed(case, feature, math.pi)
    ready = prepare(aim, [chain])
    chosen = select(
        score(aim, ready, run(aim, ready, design(aim, 6, 1))),
        Constraints(
            tolerance_um=aim.tolerance_um,
            tolerance_theta_rad=aim.tolerance_theta_rad,
            target=aim.target,
            visible=visible_share(aim),
            in_set=True,
        ),
    )
    if chosen.chosen is None:
        return chosen.advice
    return measurement_of(
        feature, chosen.chosen, about_um=(0, 0), theta_rad=case.theta_rad
    )


def test_another_feature_is_used_when_the_notch_is_hidden(look: Look) -> None:
    outline = long_tooth_gear()
    layer = Layer(name="gear", outline=outline, z_um=0.0, reflectance=0.8)
    case = look("find_gear")
    calm = replace(case.spread, pose_sigma_xy_um=0.5, search_um=2.0)
    free = replace(
        case, moving=(layer,), spread=calm, tolerance_um=2.0, tolerance_theta_rad=0.02
    )
    hidden = replace(free, static=(over_the_notch(),))
    features = {f.kind: f for f in propose(outline)}
    ways = ((features["teeth"], RIM), (features["outline"], ("ncc",)))
    need = PoseRequirement(
        sigma_um=1.0, sigma_theta_rad=0.01, radius_um=75.0, redundant=False
    )
    used = []
    for shown in (free, hidden):
        sights = [sight(shown, feature, chain) for feature, chain in ways]
        able = [s for s in sights if isinstance(s, FeatureMeasurement)]
        found = choose_set(able, need)
        assert found.qualifies
        used.append((found.names, [s.name for s in able]))
    teeth, whole = features["teeth"].name, features["outline"].name
    assert used[0] == ((teeth,), [teeth, whole])
    assert used[1] == ((whole,), [whole])
    (reason,) = (s for s in sights if isinstance(s, str))
    assert "no chain is reliable" in reason


def test_two_edges_tell_the_pose_that_neither_tells(look: Look) -> None:
    bracket = look("bracket")
    calm = replace(
        bracket.spread, pose_sigma_xy_um=0.5, pose_sigma_theta_rad=0.01, search_um=2.0
    )
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
                [seen],
                Constraints(tolerance_um=1.0, tolerance_theta_rad=None, in_set=True),
            )
            assert alone.chosen == seen
            sights.append(
                measurement_of(feature, seen, about_um=(0, 0), theta_rad=case.theta_rad)
            )
    need = PoseRequirement(
        sigma_um=0.5, sigma_theta_rad=0.01, radius_um=80.0, redundant=False, most=2
    )
    found = choose_set(sights, need)
    assert found.qualifies
    assert sorted(found.names) == ["edge1", "edge2"]
    assert math.isinf(found.dropped_um)
