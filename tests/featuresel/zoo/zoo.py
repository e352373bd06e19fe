"""Routines and settings known to be bad, each with the look that shows why."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import Routine
from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.score import ChainScore
from microplan.optics.outline.outline import Outline
from microplan.optics.render.scene import Layer
from tests.featuresel.conftest import (
    bore_in_fingers,
    bracket,
    disc,
    find_gear,
    make_case,
    on_target,
    post_alone,
    see_fingers,
)
from tests.featuresel.zoo import zoo_angles, zoo_places

ANIMALS: tuple[Routine, ...] = (
    zoo_angles.HOMOGRAPHY,
    zoo_angles.NEAREST_TOOTH,
    zoo_places.BEST_OF_MANY,
    zoo_places.BLURRED_ECC,
    zoo_places.CORNERS,
    zoo_places.PHASE_ONLY,
    zoo_places.RAW_CENTROID,
    zoo_places.ROUNDED_WARP,
    zoo_places.STAY,
    zoo_places.WHOLE_ELLIPSE,
    zoo_places.WHOLE_PIXEL,
    zoo_places.WORN_TEMPLATE,
    zoo_places.WRONG_POLARITY,
)


@dataclass(frozen=True, kw_only=True)
class Resident:
    """A bad chain, the words of its rejection, and what its score must show."""

    chain: Chain
    words: str
    shows: Callable[[ChainScore], bool]
    tolerance_um: float
    tolerance_theta_rad: float | None = None


@dataclass(frozen=True, kw_only=True)
class Cage:
    """A look with a chain that is kept on it, and those that are not."""

    look: Callable[[], LookCase]
    good: Chain
    residents: tuple[Resident, ...]


def comb() -> LookCase:
    """Five studs in a row, 14 um apart: each looks like its neighbours."""
    studs = Outline(rings=tuple(disc(5, 14 * k) for k in range(-2, 3)))
    layer = Layer(name="comb", outline=studs, z_um=0.0, reflectance=0.75)
    case = make_case("outline", {"extent_um": 36.0}, (layer,))
    return replace(case, key="comb", background=0.15)


def gear_beyond_reversal() -> LookCase:
    """The gear so far out of focus that its teeth are dark, its angle about known."""
    case = replace(find_gear(), focus_um=25.0, theta_any=False, key="beyond")
    case = on_target(replace(case, spread=replace(case.spread, focus_sigma_um=0.5)))
    return replace(case, target=replace(case.target, theta_range_rad=0.26))


def still_post() -> LookCase:
    """The post 10 um out of focus, where nothing but its place varies."""
    case = replace(post_alone(), focus_um=10.0, key="still")
    spread = replace(
        case.spread, focus_sigma_um=0.0, magnification_sigma=0.0,
        light_gain=(1.0, 1.0), light_gradient=(0.0, 0.0),
    )  # fmt: skip
    return replace(case, spread=spread)


def bracket_about_known() -> LookCase:
    """The bracket within 2 degrees; its drawing's origin is not its middle."""
    case = on_target(replace(bracket(), theta_any=False, key="bracket_known"))
    spread = replace(
        case.spread, pose_sigma_theta_rad=math.radians(1), magnification_sigma=0.0
    )
    return replace(
        case, spread=spread, target=replace(case.target, theta_range_rad=0.1)
    )


def is_mostly_bias(score: ChainScore) -> bool:
    """Return whether what is wrong is constant in the target's frame."""
    assert score.bias_um is not None
    assert score.sigma_um is not None
    return math.hypot(*score.bias_um) > 2 * score.sigma_um


def is_mostly_scatter(score: ChainScore) -> bool:
    """Return whether what is wrong scatters."""
    assert score.bias_um is not None
    assert score.sigma_um is not None
    return math.hypot(*score.bias_um) < 2 * score.sigma_um


def lies_often(score: ChainScore) -> bool:
    """Return whether a good part of the answers is wrong."""
    return score.silent > score.trials / 4


def is_rarely_right(score: ChainScore) -> bool:
    """Return whether it says nothing, or what is wrong, as often as what is right."""
    return score.silent > 0 and score.success < score.trials / 2


def fails_aloud(score: ChainScore) -> bool:
    """Return whether it is wrong never, and says so often."""
    return score.silent == 0 and sum(n for _, n in score.failures) > score.trials / 4


NEED, SILENT = "2 sigma + |bias|", "silent failures"

CAGES: dict[str, Cage] = {
    "post": Cage(
        look=post_alone,
        good=("otsu", "iso_circle"),
        residents=(
            Resident(chain=("hough",), words=NEED, shows=is_mostly_scatter,
                     tolerance_um=0.5),
            Resident(chain=("phase_correlation",), words=SILENT, shows=lies_often,
                     tolerance_um=0.15),
            Resident(chain=("whole_pixel",), words=NEED, shows=is_mostly_scatter,
                     tolerance_um=0.5),
            Resident(chain=("phase_only",), words=SILENT, shows=lies_often,
                     tolerance_um=0.5),
            Resident(chain=("worn_template",), words=SILENT, shows=lies_often,
                     tolerance_um=0.5),
            Resident(chain=("stay",), words=SILENT, shows=lies_often,
                     tolerance_um=0.5),
            Resident(chain=("wrong_polarity",), words="success", shows=fails_aloud,
                     tolerance_um=0.5),
        ),
    ),
    "still_post": Cage(
        look=still_post,
        good=("otsu", "iso_circle"),
        residents=(
            Resident(chain=("otsu", "iso_circle", "rounded_warp"), words=NEED,
                     shows=is_mostly_scatter, tolerance_um=0.016),
        ),
    ),
    "bore": Cage(
        look=bore_in_fingers,
        good=("otsu", "iso_circle"),
        residents=(
            Resident(chain=("raw_centroid",), words=NEED, shows=is_mostly_bias,
                     tolerance_um=0.3),
            Resident(chain=("whole_ellipse",), words=NEED, shows=is_mostly_bias,
                     tolerance_um=0.4),
        ),
    ),
    "gear": Cage(
        look=find_gear,
        good=("otsu", "circle_caliper", "tooth_notch"),
        residents=(
            Resident(chain=("otsu", "circle_caliper", "nearest_tooth"), words=SILENT,
                     shows=lies_often, tolerance_um=1.0,
                     tolerance_theta_rad=math.radians(1)),
            Resident(chain=("otsu", "circle_caliper"), words="no angle",
                     shows=lambda score: score.angles == 0, tolerance_um=1.0,
                     tolerance_theta_rad=math.radians(1)),
            Resident(chain=("homography",), words=SILENT, shows=lies_often,
                     tolerance_um=1.0, tolerance_theta_rad=math.radians(1)),
            Resident(chain=("keypoints",), words=SILENT, shows=is_rarely_right,
                     tolerance_um=1.0, tolerance_theta_rad=math.radians(1)),
        ),
    ),
    "beyond": Cage(
        look=gear_beyond_reversal,
        good=("otsu", "circle_caliper", "ecc"),
        residents=(
            Resident(chain=("otsu", "circle_caliper", "nearest_tooth"), words=SILENT,
                     shows=lies_often, tolerance_um=1.0,
                     tolerance_theta_rad=math.radians(1)),
        ),
    ),
    "jaws": Cage(
        look=see_fingers,
        good=("edge_caliper",),
        residents=(
            Resident(chain=("corners",), words=SILENT, shows=lies_often,
                     tolerance_um=0.5),
        ),
    ),
    "comb": Cage(
        look=comb,
        good=("ncc",),
        residents=(
            Resident(chain=("best_of_many",), words=SILENT, shows=lies_often,
                     tolerance_um=1.0),
        ),
    ),
    "bracket": Cage(
        look=bracket_about_known,
        good=("ncc", "ecc"),
        residents=(
            Resident(chain=("ncc", "blurred_ecc"), words=NEED,
                     shows=is_mostly_scatter, tolerance_um=0.25),
        ),
    ),
}  # fmt: skip
