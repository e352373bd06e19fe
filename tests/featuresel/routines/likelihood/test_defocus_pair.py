from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from microplan.arrays import FloatArray
from microplan.featuresel.look.nominal import nominal_render
from microplan.featuresel.routines.contract import Artifact, Failure, Guess, Measurement
from microplan.featuresel.routines.likelihood import defocus_pair
from tests.featuresel.conftest import noisy
from tests.featuresel.fits import (
    PAIR_UM,
    Drawn,
    case,
    draw,
    limits,
    near,
    pair_artifact,
    render,
)

OFFSETS = (-PAIR_UM, PAIR_UM)
DRAWS = 25
SURE = 1e-4  # that a right routine fails a test, on either side


def pair(drawn: Drawn, rng: np.random.Generator) -> list[FloatArray]:
    look = render("post")
    return [
        noisy(case("post"), drawn.render(look, offset_um=offset), rng)
        for offset in OFFSETS
    ]


def measure(drawn: Drawn, rng: np.random.Generator) -> Measurement:
    guess = near(drawn.pose(case("post")), column=0.8, row=-0.5)
    found = defocus_pair.measure(
        pair(drawn, rng), OFFSETS, pair_artifact("post"), guess
    )
    assert isinstance(found, Measurement), found
    assert found.z_um is not None
    return found


@pytest.mark.parametrize("z_um", [-9.0, -3.0, -0.3, 0.3, 3.0, 9.0])
def test_the_side_of_focus_is_found(z_um: float) -> None:
    rng = np.random.default_rng(2)
    for _ in range(3):
        found = measure(draw("post", rng, z_um=z_um), rng)
        assert found.z_um == pytest.approx(z_um, abs=0.15)


def test_a_guess_beside_the_place_does_not_hide_the_focus() -> None:
    # a place 1.4 px off and a reach of 27 um: where fits started they ended 16 um off
    narrow = case("post")
    wide = replace(
        narrow, key="wide", spread=replace(narrow.spread, focus_sigma_um=9.0)
    )
    look, rng = nominal_render(wide), np.random.default_rng(1)
    made = defocus_pair.prepare(look, wide.target, offset_um=PAIR_UM)
    assert isinstance(made, Artifact), made
    for z_um in (-20.0, -5.0, 0.0, 0.0, 10.0, 20.0):
        drawn = draw("post", rng, z_um=z_um)
        images = [
            noisy(wide, drawn.render(look, offset_um=offset), rng) for offset in OFFSETS
        ]
        way = rng.uniform(0, 2 * np.pi)
        guess = near(
            drawn.pose(wide), column=1.4 * float(np.cos(way)), row=1.4 * np.sin(way)
        )
        found = defocus_pair.measure(images, OFFSETS, made, guess)
        assert isinstance(found, Measurement), found
        assert found.z_um == pytest.approx(z_um, abs=0.15)


@pytest.mark.parametrize("z_um", [pytest.param(0.0, marks=pytest.mark.slow), 4.0])
def test_place_and_focus_are_at_the_joint_limit(z_um: float) -> None:
    rng, errors, claimed = np.random.default_rng(6), [], []
    k = case("post").target.px_per_um
    bounds = limits(
        "post", Drawn(dz_um=z_um), ("dx_um", "dy_um", "dz_um", "zoom"),
        offsets_um=OFFSETS,
    )  # fmt: skip
    for _ in range(DRAWS):
        drawn = draw("post", rng, z_um=z_um)
        found, pose = measure(drawn, rng), drawn.pose(case("post"))
        assert found.z_um is not None
        assert found.spread_z_um is not None
        x, y = (found.column - pose.column) / k, (found.row - pose.row) / k
        errors.append((x, y, found.z_um - z_um))
        spread = found.spread_px / k
        claimed.append((spread, spread, found.spread_z_um))
    limit = np.array([bounds[key] for key in ("dx_um", "dy_um", "dz_um")])
    low, high = (chi2.ppf(p, DRAWS) / DRAWS for p in (SURE, 1 - SURE))
    own = np.sqrt(np.square(claimed).mean(axis=0))
    # what the project allows of a place, and of a pair's focus; below is no honest fit
    most = np.array([1.3, 1.3, 1.2])
    assert (own > 0.99 * limit).all()
    assert (own < most * limit).all()
    honest = (np.square(errors) / np.square(claimed)).mean(axis=0)
    assert ((low < honest) & (honest < high)).all()
    square = (np.square(errors) / limit**2).mean(axis=0)
    assert ((low < square) & (square < high * most**2)).all()


def test_images_and_offsets_go_together() -> None:
    image = render("post")()
    guess = Guess(column=99.7, row=99.6)
    for images, offsets in (([image], [0.0]), ([], []), ([image, image], [1.0])):
        with pytest.raises(ValueError, match="two images"):
            defocus_pair.measure(images, offsets, pair_artifact("post"), guess)


def test_what_is_no_image_is_refused() -> None:
    image = render("post")()
    hollow = np.where(image > image.mean(), np.nan, image)
    for images in ([image, hollow], [hollow, image]):
        found = defocus_pair.measure(
            images, OFFSETS, pair_artifact("post"), Guess(column=99.7, row=99.6)
        )
        assert isinstance(found, Failure)


@pytest.mark.parametrize("value", [0.0, 0.4, 1.0])
def test_images_of_nothing_are_refused_and_left_as_they_are(value: float) -> None:
    guess = Guess(column=99.7, row=99.6)
    for shape in ((200, 200), (8, 8)):
        image = np.full(shape, value)
        image.setflags(write=False)
        found = defocus_pair.measure(
            [image, image], OFFSETS, pair_artifact("post"), guess
        )
        assert isinstance(found, Failure)


def test_a_look_without_contrast_is_not_prepared() -> None:
    shown = case("post")
    flat = replace(shown.moving[0], reflectance=shown.background)
    look = nominal_render(replace(shown, moving=(flat,)))
    made = defocus_pair.prepare(look, shown.target, offset_um=PAIR_UM)
    assert not isinstance(made, Artifact)
    assert made.code == "no_contrast"
