"""Trials of several features on one image: what they tell, who may be missing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import f as fisher_f

from microplan.featuresel.features.features import propose
from microplan.featuresel.look.design import design
from microplan.featuresel.look.discrepancy import Discrepancy
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Failure
from microplan.featuresel.sets.feature_set import choose_set
from microplan.featuresel.sets.pose_covariance import (
    FeatureMeasurement,
    PoseRequirement,
    measurement_of,
)
from microplan.featuresel.sets.set_trials import Member, repeated_set, score_set
from microplan.featuresel.trials.repeatability import Trueness
from microplan.featuresel.trials.score import ChainScore, score
from microplan.featuresel.trials.trials import prepare, run
from tests.featuresel.aims import aimed
from tests.featuresel.conftest import CASES

OWN, FRESH = 16, 20  # trials of a feature alone, and of a set
RADIUS_UM = 80.0  # of the bracket about its origin
TURN_RAD, RANGE_RAD = 0.01, 0.05
CORNERS = ("corner1", "corner2")
EDGES = ("edge1", "edge2")
ROUTINES = {"corner": "corner", "edge": "line_caliper"}


@cache
def bracket() -> LookCase:
    """Return a look at the bracket about its origin, nearly in place.

    Zoom and focus are as planned: their errors move all features together, and no
    spread of single features tells of that.
    """
    case = CASES["bracket"]()
    spread = replace(
        case.spread, focus_sigma_um=0.0, magnification_sigma=0.0,
        pose_sigma_xy_um=0.5, pose_sigma_theta_rad=TURN_RAD, search_um=1.5,
    )  # fmt: skip
    target = replace(case.target, theta_range_rad=RANGE_RAD)
    return replace(
        case, spread=spread, target=target, theta_any=False, tolerance_theta_rad=0.01
    )


@cache
def tried(name: str) -> tuple[Member, FeatureMeasurement]:
    """Return a feature of the bracket after trials of its own."""
    case = bracket()
    feature = next(f for f in propose(case.moving[0].outline) if f.name == name)
    # it lies off the origin: turns of the part move it too
    sigma = math.hypot(0.5, TURN_RAD * math.hypot(*feature.center_um))
    spread = replace(case.spread, pose_sigma_xy_um=sigma, search_um=3 * sigma)
    own = aimed(replace(case, spread=spread), feature, RANGE_RAD)
    ready = prepare(own, [(ROUTINES[feature.kind],)])
    (seen,) = score(own, ready, run(own, ready, design(own, OWN, 1)))
    measurement = measurement_of(
        feature, seen, about_um=(0, 0), theta_rad=case.theta_rad
    )
    member = Member(
        case=own, prepared=ready, score=seen, offset_um=feature.center_um,
        sigma_um=measurement.sigma_um,
    )  # fmt: skip
    return member, measurement


def members(*names: str) -> list[Member]:
    return [tried(name)[0] for name in names]


def together(some: Sequence[Member], least: int, count: int = FRESH) -> ChainScore:
    case = bracket()
    return score_set(case, some, design(case, count, 2), least=least)


def missing(member: Member) -> Member:
    """Return the feature with a routine that could not be prepared."""
    (name,) = member.chain
    fault = Failure(code="no_edge", message="nothing is drawn there")
    return replace(member, prepared=replace(member.prepared, artifacts={name: fault}))


@pytest.mark.parametrize(("names", "spare"), [(CORNERS, True), (EDGES, False)])
def test_a_set_tells_the_pose_as_well_as_was_predicted(
    names: tuple[str, str], spare: bool
) -> None:
    need = PoseRequirement(
        sigma_um=0.5, sigma_theta_rad=0.01, radius_um=RADIUS_UM, most=2, redundant=spare
    )
    found = choose_set([tried(name)[1] for name in names], need)
    assert found.qualifies
    assert sorted(found.names) == sorted(names)
    seen = together(members(*names), 2)
    assert (seen.chain, seen.trials, seen.success) == (names, FRESH, FRESH)
    assert seen.failures == ()
    # both variances are estimates: their ratio is F distributed, at most, as a
    # feature's spread is that of its worse axis and holds its bias; one in 10 000
    # for each of the two axes and the angle
    most = fisher_f.isf(1e-4 / 3, FRESH, OWN - 1)
    assert seen.rms_um is not None
    assert seen.rms_um**2 < most * found.known.sigma_um**2
    assert seen.sigma_theta_rad is not None
    assert seen.sigma_theta_rad**2 < most * found.known.sigma_theta_rad**2


def test_a_feature_may_be_missing_if_the_others_are_enough() -> None:
    first, second = members(*CORNERS)
    third = missing(tried("corner3")[0])
    two = together([first, second], 2, 6)
    three = together([first, third, second], 2, 6)
    assert three.success == 6
    assert (three.bias_um, three.sigma_um) == (two.bias_um, two.sigma_um)
    assert three.chain == ("corner1", "corner3", "corner2")


def test_a_set_says_so_where_too_few_answer() -> None:
    first, second = members(*CORNERS)
    seen = together([first, missing(second)], 2, 6)
    assert (seen.success, seen.silent) == (0, 0)
    assert seen.failures == (("not_prepared", 6),)


def test_a_set_is_looked_for_from_further_focus_stops() -> None:
    """Features that one stop shows count at the next, as in a run."""
    case, some = bracket(), members(*CORNERS)
    near = design(case, 6, 2)
    far = [replace(trial, dz_um=trial.dz_um - 600.0) for trial in near]
    assert score_set(case, some, far, least=2).success == 0
    assert score_set(case, some, far, least=2, stops_um=(-600.0,)).success == 0
    seen = score_set(case, some, far, least=2, stops_um=(-600.0, 600.0))
    assert seen.success == 6
    assert score_set(case, some, near, least=2, stops_um=(600.0,)) == together(
        some, 2, 6
    )


def test_a_feature_taken_for_another_is_noticed() -> None:
    """One corner is a tenth of a tolerance, some twenty sigmas, from where it was."""
    first, second = members(*CORNERS)
    x, y = second.offset_um
    wrong = replace(second, offset_um=(x + bracket().tolerance_um / 10, y))
    seen = together([first, wrong], 2, 6)
    assert seen.silent == 0
    assert seen.failures == (("features_disagree", 6),)


def test_the_bias_of_a_feature_is_taken_off_in_the_parts_frame() -> None:
    """All features carried aside by as much carry the part aside by that."""
    aside = (0.3, -0.2)
    some = members(*EDGES)

    def moved(member: Member) -> Member:
        x, y = member.score.bias_um or (0.0, 0.0)
        bias = (x + aside[0], y + aside[1])
        return replace(member, score=replace(member.score, bias_um=bias))

    plain = together(some, 2, 6)
    seen = together([moved(member) for member in some], 2, 6)
    assert plain.bias_um is not None
    assert seen.bias_um is not None
    # it is turned by angles that are each known to a thousandth at worst
    change = [b - a for a, b in zip(plain.bias_um, seen.bias_um, strict=True)]
    assert change == pytest.approx([-aside[0], -aside[1]], abs=1e-3)


def test_cost_is_that_of_all_features() -> None:
    some = members(*EDGES)
    assert together(some, 2, 1).cost == pytest.approx(sum(m.score.cost for m in some))


def test_order_and_workers_do_not_matter() -> None:
    some, case = members(*EDGES), bracket()
    trials = design(case, 4, 2)

    def backwards(function, items):  # type: ignore[no-untyped-def]  # as `Map`
        return [function(item) for item in list(items)[::-1]][::-1]

    plain = score_set(case, some, trials, least=2)
    assert score_set(case, some, trials, least=2, map=backwards) == plain
    turned = score_set(case, some[::-1], trials, least=2)
    assert turned.bias_um == pytest.approx(plain.bias_um, abs=1e-9)
    assert turned.sigma_um == pytest.approx(plain.sigma_um, abs=1e-9)


def test_a_set_needs_members_and_trials() -> None:
    case = bracket()
    with pytest.raises(ValueError, match="members and trials"):
        score_set(case, [], design(case, 1, 1), least=1)
    with pytest.raises(ValueError, match="members and trials"):
        score_set(case, members("edge1"), [], least=1)


def test_trueness_is_what_discrepancies_move_the_pose_by() -> None:
    """By the same trials without any, whose noise is nearly the same."""
    some, plain = members(*CORNERS), bracket()
    rough = replace(
        plain,
        discrepancy=Discrepancy(
            edge=0.01, flat=0.0, pixel=0.0, fine_um=2.0, size_um=30.0
        ),
    )
    trials = design(plain, 24, 2)
    without = repeated_set(plain, some, trials, least=2)
    assert without.trueness == (Trueness(),)
    found = repeated_set(rough, some, trials, least=2)
    assert found.scores == (score_set(rough, some, trials, least=2),)
    off = [
        np.subtract(there.target_um, here.target_um)
        for there, here in zip(found.outcomes, without.outcomes, strict=True)
        if there.target_um is not None and here.target_um is not None
    ]
    assert len(off) >= 20  # corners of the design are refused more often
    (true,) = found.trueness
    assert true.um is not None
    assert true.um == pytest.approx(np.sqrt(np.square(off).mean(axis=0)), rel=0.25)
    assert true.rad is not None
    assert min(*true.um, true.rad) > 0
