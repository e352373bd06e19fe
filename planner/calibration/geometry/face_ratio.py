"""How bright the background is against the part's face: a ratio of reflectances."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from microplan.featuresel.look.scenario import LookCase
from microplan.planner.calibration.estimates import BlockEstimate, Refused, jackknife
from microplan.planner.calibration.geometry.light_field import PlacedGain

ABSOLUTE = (
    "no absolute reflectance: pictures tell ratios; photograph a mirror of known "
    "reflectance beside the part in the same light"
)
# of the part's light: images of the compiler and of twins differ by it far from edges
_TRUE = 2e-4
_METHOD = "light beside the part over that on it, places left out"


def face_ratio(
    groups: Sequence[Sequence[PlacedGain]], case: LookCase, *, has_black: bool
) -> BlockEstimate | Refused:
    """Return the background's reflectance over the part's.

    Light that the lens scatters counts as the background's.

    Parameters
    ----------
    groups : sequence of sequence of PlacedGain
        Pictures at one place each.
    case : LookCase
        Whose image they are fitted by.
    has_black : bool
        Whether the counts without light are stated: else they look like reflectance.
    """
    what = "ratio of reflectances"
    if not has_black:
        why = "the workcell states no black_level, which looks alike"
        return Refused(what=what, why=why, take="one scene in several lights first")
    faces = {layer.reflectance for layer in case.moving}
    is_shaded = case.lamp_aperture is not None and case.background_z_um is not None
    is_narrow = case.microscope.lamp_aperture is not None
    if case.ring is not None or is_shaded or is_narrow or len(faces) != 1:
        why = "faces are not of one brightness in this light"
        return Refused(what=what, why=why, take="the part in coaxial light")
    if not any(groups):
        return Refused(what=what, why="no picture shows the part", take="it whole")
    part, around = (case.light.gain * each for each in (*faces, case.background))

    def ratio(some: Sequence[Sequence[PlacedGain]]) -> float:
        seen = [
            np.mean([[e.light_of(around), e.light_of(part)] for e in group], axis=0)
            for group in some
        ]
        dark, bright = np.sum(seen, axis=0).tolist()
        return float(dark / bright)

    found = jackknife(ratio, [group for group in groups if group], method=_METHOD)
    if found.sigma is None:
        return found
    return replace(found, sigma=math.hypot(found.sigma, _TRUE))
