"""Otsu seeds, the threshold judged by scikit-image."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from skimage.filters import threshold_otsu
from skimage.measure import label, regionprops

from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Artifact, Failure, Guess, Measurement
from microplan.featuresel.routines.template import otsu
from microplan.optics.outline.outline import place

Look = Callable[[str], LookCase]


def prepared(case: LookCase) -> Artifact:
    artifact = otsu.prepare(nominal_render(case), case.target)
    assert isinstance(artifact, Artifact)
    return artifact


def start(case: LookCase) -> Guess:
    target = case.target
    return Guess(column=target.column, row=target.row, theta_rad=case.theta_rad)


@pytest.mark.parametrize("name", ["find_gear", "bore", "post"])
def test_a_seed_is_within_a_pixel(
    name: str, look: Look, measured: Callable[..., Any]
) -> None:
    sample = measured(look(name), "otsu")
    assert sample.failures == ()
    assert np.hypot(*sample.errors_um.T).max() < look(name).microscope.um_per_px


def test_area_agrees_with_scikit_image(look: Look) -> None:
    case = look("find_gear")
    image = nominal_render(case)()
    level = threshold_otsu(image)  # type: ignore[no-untyped-call] # skimage
    labels = label(image > level, connectivity=1)  # type: ignore[no-untyped-call]
    blobs = regionprops(labels)  # type: ignore[no-untyped-call] # skimage
    largest = max(blob.area for blob in blobs)
    # the routine smooths by one pixel first: corners of teeth move, 3 % of the area
    assert prepared(case).parameters["area_px"] == pytest.approx(largest, rel=0.03)


def test_the_notch_bias_is_undone_where_the_angle_is_known(look: Look) -> None:
    case = look("bore")
    artifact = prepared(case)
    bias = math.hypot(*(artifact.parameters[f"offset_{a}_px"] for a in "xy"))
    assert bias > 0.2  # the notch pulls the dark blob's centroid
    image = nominal_render(case)(theta_rad=1.2)
    guess = replace(start(case), theta_rad=case.theta_rad + 1.2)
    found = otsu.measure(image, artifact, guess)
    assert isinstance(found, Measurement)
    off = math.hypot(found.column - guess.column, found.row - guess.row)
    assert off < 0.5 * bias


def test_an_off_centre_reference_needs_the_angle(look: Look) -> None:
    found = otsu.prepare(nominal_render(look("bracket")), look("bracket").target)
    assert isinstance(found, Failure)
    assert found.code == "off_centre"


def test_blank_and_wrong_images_are_refused(
    look: Look, expose_image: Callable[..., Any]
) -> None:
    case, rng = look("find_gear"), np.random.default_rng(2)
    artifact = prepared(case)
    blank = expose_image(case, np.full((200, 200), 0.4), rng)
    empty = otsu.measure(blank, artifact, start(case))
    assert isinstance(empty, Failure)
    assert empty.code == "no_contrast"
    post = otsu.measure(nominal_render(look("post"))(), artifact, start(case))
    assert isinstance(post, Failure)
    assert post.code == "no_blob"


def test_two_alike_are_ambiguous(look: Look) -> None:
    case = look("post")
    post = case.moving[0]
    twin = replace(post, name="twin", outline=place(post.outline, 54.0, 0.0))
    both = replace(case, static=(twin,), target=replace(case.target, search_px=40.0))
    middle = Guess(column=case.target.column + 25, row=case.target.row)
    found = otsu.measure(nominal_render(both)(), prepared(both), middle)
    assert isinstance(found, Failure)
    assert found.code == "ambiguous"


@pytest.mark.parametrize("name", ["find_gear", "bore", "post"])
def test_its_own_spread_is_what_its_errors_have(
    name: str, look: Look, measured: Callable[..., Any]
) -> None:
    """By draws of pose, focus, zoom and light that `prepare` has not seen."""
    case = look(name)
    own_um = prepared(case).parameters["spread_px"] * case.microscope.um_per_px
    errors = measured(case, "otsu").errors_um
    rms = math.sqrt(float(np.square(errors).mean(axis=0).max()))
    assert rms / 3 < own_um < 3 * rms
