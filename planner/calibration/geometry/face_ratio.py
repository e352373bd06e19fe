"""How bright background and faces are against the part's: ratios of reflectances."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.look.scenario import LookCase
from microplan.planner.calibration.estimates import (
    BlockEstimate,
    Refused,
    jackknife_vector,
)
from microplan.planner.calibration.geometry.face_images import (
    blurred_faces,
    face_names,
)
from microplan.planner.calibration.geometry.light_field import PlacedGain

ABSOLUTE = (
    "no absolute reflectance: pictures tell ratios; photograph a mirror of known "
    "reflectance beside the part in the same light"
)
# of the part's light: the compiler's images and those of twins, without noise, tell
# ratios that differ by 1e-4 to 4e-4
_TRUE = 4e-4
_METHOD = "light of both faces, places left out"
_WHAT = "ratio of reflectances"
_BACKGROUND = "background"
# of the part's reflectance, by which a face may be misstated: then the part is placed
# so far off that ratios err by their standard deviation
_NEAR = 0.05


def face_ratios(
    groups: Sequence[Sequence[PlacedGain]], case: LookCase, *, has_black: bool
) -> dict[str, BlockEstimate | Refused]:
    """Return the reflectance of the background and of faces on a part over its own.

    By their names. Light that the lens scatters counts as the background's.

    Parameters
    ----------
    groups : sequence of sequence of PlacedGain
        Pictures at one place each.
    case : LookCase
        Whose image they are fitted by.
    has_black : bool
        Whether the counts without light are stated: else they look like reflectance.
    """
    groups = [group for group in groups if group]
    hindered = _hindered(groups, case, has_black=has_black)
    if hindered is not None:
        return {_BACKGROUND: hindered}
    part, around = (
        case.light.gain * each for each in (case.moving[0].reflectance, case.background)
    )

    def ratios(some: Sequence[Sequence[PlacedGain]]) -> FloatArray:
        seen = [
            np.mean([each.lights(around, part) for each in group], axis=0)
            for group in some
        ]
        bright, *others = np.sum(seen, axis=0)
        return np.asarray(others, dtype=np.float64) / float(bright)

    all_of = jackknife_vector(ratios, groups, method=_METHOD)
    found: dict[str, BlockEstimate] = {}
    for k, name in enumerate((_BACKGROUND, *face_names(case))):
        one = all_of.one(k)
        sigma = None if one.sigma is None else math.hypot(one.sigma, _TRUE)
        found[name] = replace(one, sigma=sigma)
    blurred = _blurred(case)
    seen = {name: one for name, one in found.items() if name not in blurred}
    return seen | blurred | _misstated(seen, case)


def _hindered(
    groups: Sequence[object], case: LookCase, *, has_black: bool
) -> Refused | None:
    """Return why pictures tell no ratio at all, None if they do."""
    if not has_black:
        why = "the workcell states no black_level, which looks alike"
        return Refused(what=_WHAT, why=why, take="one scene in several lights first")
    is_shaded = case.lamp_aperture is not None and case.background_z_um is not None
    is_narrow = case.microscope.lamp_aperture is not None
    if case.ring is not None or is_shaded or is_narrow:
        why = "faces are not of one brightness in this light"
        return Refused(what=_WHAT, why=why, take="the part in coaxial light")
    if not groups:
        return Refused(what=_WHAT, why="no picture shows the part", take="it whole")
    return None


def _misstated(
    found: Mapping[str, BlockEstimate], case: LookCase
) -> dict[str, Refused]:
    """Return why faces found on a part err, by their names: one is not as stated."""
    own, *others = (layer.reflectance for layer in case.moving)
    pairs = zip(face_names(case), others, strict=True)
    said = {name: each / own for name, each in pairs if name in found}
    if all(abs(found[name].value - each) <= _NEAR for name, each in said.items()):
        return {}
    words = "--faces says {:.3g}, pictures about {:.3g}"
    return {
        name: Refused(
            what=f"{_WHAT} of {name}",
            why=words.format(each, found[name].value),
            take="no more: state that",
        )
        for name, each in said.items()
    }


def _blurred(case: LookCase) -> dict[str, Refused]:
    """Return why faces on a part, by their names, tell none: edges' blur fills them."""
    if len(case.moving) == 1:
        return {}
    own, *others = blurred_faces(case)
    found = {}
    for name, is_blurred in zip(face_names(case), others, strict=True):
        if own or is_blurred:
            whose = "the part beside it" if own else "it"
            why = f"blur of its edges fills {whose}"
            what = f"{_WHAT} of {name}"
            found[name] = Refused(what=what, why=why, take="it at more magnification")
    return found
