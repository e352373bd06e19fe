"""Feddema's criteria and what of a target is seen."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest

from microplan.featuresel.features.feature import Feature, seen_share
from microplan.featuresel.features.features import propose
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Occluders
from microplan.featuresel.selection.evaluate import visible_share
from microplan.featuresel.sets.criteria import (
    COLUMNS,
    Candidate,
    Criteria,
    criteria,
    set_criteria,
    uniqueness,
)
from microplan.featuresel.sets.pose_covariance import measurement_of
from microplan.featuresel.trials.bounds import failure_upper, success_lower
from microplan.featuresel.trials.score import ChainScore
from microplan.optics.outline.outline import Outline, Ring, Segment, place
from tests.featuresel.aims import target_of

RADIUS = 60.0


def polygon(*points: tuple[float, float]) -> Ring:
    ends = points[1:] + points[:1]
    return Ring(
        edges=tuple(Segment(start=a, end=b) for a, b in zip(points, ends, strict=True))
    )


ELL = Outline(
    rings=(polygon((-60, -50), (60, -50), (60, -20), (-20, -20), (-20, 60), (-60, 60)),)
)


def a_score(*, theta: float | None = 0.001, axis: float | None = None) -> ChainScore:
    return ChainScore(
        chain=("corner",), trials=64, success=64, success_lower=success_lower(64, 64),
        silent=0, silent_upper=failure_upper(0, 64), failures=(),
        bias_um=(0.03, 0.04), sigma_um=0.12, worst_um=0.5, angles=0 if theta is None
        else 64, bias_theta_rad=None if theta is None else 0.0,
        sigma_theta_rad=theta, cost=4.0, axis_rad=axis,
    )  # fmt: skip


def candidate(
    feature: Feature, score: ChainScore, seen: float | None = 1.0
) -> Candidate:
    measurement = measurement_of(feature, score, about_um=(0.0, 0.0), theta_rad=0.3)
    return Candidate(feature=feature, score=score, measurement=measurement, seen=seen)


def kinds(kind: str) -> list[Feature]:
    return [f for f in propose(ELL) if f.kind == kind]


def by_rules(some: Candidate, *, angle: bool = True) -> Criteria:
    return criteria(some, radius_um=RADIUS, theta_range_rad=math.pi, angle=angle)


def test_every_column_is_a_field() -> None:
    names = [f.name for f in fields(Criteria)]
    assert names == ["name", "chain", *COLUMNS]


def test_a_corner_tells_the_pose_and_an_edge_does_not() -> None:
    corner, edge = kinds("corner")[0], kinds("edge")[0]
    row = by_rules(candidate(corner, a_score(), 0.8))
    assert row.robustness == pytest.approx(0.05 ** (1 / 64))  # none of 64 failed
    assert (row.uniqueness, row.completeness, row.cost) == (1.0, 0.8, 4.0)
    assert row.resolution_um == pytest.approx(0.13)  # .12, and a bias of .05
    assert row.rank == 3
    assert row.controllability > 0
    assert 1 <= row.conditioning < 50
    blind = by_rules(candidate(edge, a_score(axis=0.0)))
    assert (blind.rank, blind.controllability) == (2, 0.0)
    assert math.isinf(blind.conditioning)


def test_places_are_enough_where_no_angle_is_wanted() -> None:
    corner = kinds("corner")[0]
    row = by_rules(candidate(corner, a_score(theta=None)), angle=False)
    assert row.rank == 2
    assert row.conditioning == pytest.approx(1.0)
    assert row.uniqueness == 1.0


def test_a_set_sees_what_one_alone_does_not() -> None:
    first, second = kinds("corner")[:2]
    score = a_score(theta=None)
    pair = [candidate(first, score, 1.0), candidate(second, score, 0.5)]
    alone = by_rules(pair[0])
    both = set_criteria(
        pair, 0.1, radius_um=RADIUS, theta_range_rad=math.pi, angle=True
    )
    assert (alone.rank, both.rank) == (2, 3)
    assert both.robustness == pytest.approx(alone.robustness**2)
    assert both.cost == 8.0
    lengths = [first.edge_um, second.edge_um]
    share = (lengths[0] + 0.5 * lengths[1]) / sum(lengths)
    assert both.completeness == pytest.approx(share)
    unknown = [pair[0], replace(pair[1], seen=None)]
    found = set_criteria(
        unknown, 0.1, radius_um=RADIUS, theta_range_rad=1.0, angle=True
    )
    assert found.completeness is None
    with pytest.raises(ValueError, match="at least one"):
        set_criteria([], 0.1, radius_um=RADIUS, theta_range_rad=1.0, angle=True)


def test_uniqueness_is_how_far_the_likest_turn_is_from_right(
    look: Callable[[str], LookCase],
) -> None:
    gear = look("find_gear").moving[0].outline
    teeth = next(f for f in propose(gear) if f.kind == "teeth")
    notch = 6 + 2 * (30 - math.sqrt(25**2 - 3**2))  # its floor and both its sides
    share = notch / (teeth.edge_um + notch)
    wide = uniqueness(teeth, math.pi, angle=True)
    assert wide == pytest.approx(share, rel=1e-3)
    half_pitch = math.pi / 18
    assert uniqueness(teeth, half_pitch * 0.999, angle=True) == 1.0
    assert uniqueness(teeth, half_pitch * 1.001, angle=True) == wide
    plain = replace(teeth, symmetry_broken_by="", alike=0.0)
    assert uniqueness(plain, math.pi, angle=True) == 0.0
    assert uniqueness(plain, half_pitch * 0.999, angle=True) == 1.0
    circle = next(f for f in propose(gear) if f.kind == "circle")
    assert uniqueness(circle, 0.1, angle=True) == 0.0
    assert uniqueness(circle, math.pi, angle=False) == 1.0


def test_a_sight_is_where_the_placed_part_has_the_feature() -> None:
    feature = kinds("corner")[0]
    measurement = measurement_of(
        feature, a_score(), about_um=(5.0, -3.0), theta_rad=0.3
    )
    # the second road: the outline itself placed in the world
    placed = place(place(ELL, -5.0, 3.0), 0.0, 0.0, 0.3)
    points = [edge.start for ring in placed.rings for edge in ring.edges]
    assert (
        min(math.dist((measurement.x_um, measurement.y_um), point) for point in points)
        < 1e-9
    )


def test_seen_is_what_lies_in_the_region_and_behind_nothing() -> None:
    outline = kinds("outline")[0]
    rows, columns = 200, 200
    target = target_of(
        outline, ELL, column=99.5, row=99.5, theta_rad=0.0, px_per_um=1.0
    )
    clear = Occluders(light=np.zeros((rows, columns)), through=np.ones((rows, columns)))
    assert seen_share(target, clear, contrast=0.5) == 1.0
    # a finger over all that is left of the middle: x below the middle of the bounds
    through = clear.through.copy()
    through[:, :100] = 0.0
    # left of it: of the bottom 60 um, then 110, 40, 80, and 20 of the inner edge
    expected = 1 - (60 + 110 + 40 + 80 + 20) / 460
    covered = Occluders(light=clear.light, through=through)
    # points are half a pixel apart, of 460 um of edges
    share = seen_share(target, covered, contrast=0.5)
    assert share == pytest.approx(expected, abs=4 * 0.5 / 460)
    aside = replace(target, column=-1000.0)
    assert seen_share(aside, clear, contrast=0.5) == 0.0
    assert seen_share(replace(target, contour=()), clear, contrast=0.5) is None


def test_an_edge_behind_a_dark_occluder_is_seen_by_its_own_step() -> None:
    outline = kinds("outline")[0]
    target = target_of(
        outline, ELL, column=99.5, row=99.5, theta_rad=0.0, px_per_um=1.0
    )
    dark = np.full((200, 200), 0.047)
    occluder = Occluders(light=np.full((200, 200), 0.2), through=dark)
    # of 8 bits a step of .47 x .047 is 5.6 levels, one of .2 x .047 is 2.4
    assert seen_share(target, occluder, contrast=0.47) == 1.0
    assert seen_share(target, occluder, contrast=0.2) == 0.0


def test_fingers_over_a_gear_hide_a_part_of_it(look: Callable[[str], LookCase]) -> None:
    free, between = look("find_gear"), look("between")
    shares = [visible_share(case) for case in (free, between)]
    assert shares[0] == 1.0
    assert shares[1] is not None
    assert 0 < shares[1] <= 1
