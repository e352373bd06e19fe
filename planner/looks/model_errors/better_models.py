"""Better models of a look's image, by the effect that they model better."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from microplan.featuresel.look.perturb import as_tried
from microplan.featuresel.look.scenario import LookCase
from microplan.optics.coherence.unmodelled import FLAT_BAND, vectorial_otf
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Layer
from microplan.optics.transfer.microscope import Terms
from microplan.optics.transfer.otf import diffraction
from microplan.planner.assembly.assembly import Body
from microplan.planner.looks.model_errors.halo_ends import HALO, halo_ends
from microplan.planner.looks.model_errors.wavefront_ends import (
    UNKNOWN,
    unknown_wavefronts,
)
from microplan.planner.task.workcell import WavefrontSpec
from microplan.planner.views.light.unknown_walls import by_layer

LAYERS, SHADE = "layers of different height", "shade of higher bodies"
LAW, BAND = "defocus law", "band and tile"
VECTORS, SPECTRUM = "vectorial field", "spectrum of the light"
WALLS, FINISH = "side walls", "finish of faces"
# It has an interval of its own in the lower bound: `PastMeasurement.coherence_um`.
CHARGED = ("partial coherence",)
# Share of the aperture whose scalar transfer function, with that of all of it, makes up
# the vectorial one to an eighth of what the two differ by.
_INNER = 0.7
_FREQUENCIES = 64
_COLOURS = 3  # Gauss nodes over the flat band


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageModel:
    """How an image is made: a mean of looks, or rays through each pixel."""

    cases: tuple[tuple[float, LookCase], ...]  # with weights whose sum is 1
    is_traced: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class BetterModel:
    """A better model of some effects; two ends where only an interval is known."""

    effects: tuple[str, ...]  # rows of the ledger
    by: str  # in words
    ends: tuple[ImageModel, ...]
    # each end at half of the poses; else both at all of them
    alternates: bool = False
    # whether ends are components of one unknown that stays in the world: the opposite
    # of each is as likely, and moves answers the other way
    is_either_way: bool = False
    # whether trials draw what lies between the ends, so that it is in their errors
    is_drawn: bool = False
    against: LookCase | None = None  # what it is better than; None: the look as tried


def better_models(
    case: LookCase,
    effects: Collection[str],
    bodies: Sequence[Body],
    wavefront: WavefrontSpec,
) -> tuple[BetterModel, ...]:
    """Return the better models of effects; those that have none are in none of them.

    Parameters
    ----------
    case : LookCase
        The look as trials image it.
    effects : collection of str
        Rows of its ledger that are above their limits.
    bodies : sequence of Body
        All that is in the world, with what is known of walls and faces.
    wavefront : WavefrontSpec
        What is known of the objective; trials have the terms that are stated.
    """
    rows: tuple[tuple[tuple[str, ...], Callable[[], BetterModel | None]], ...] = (
        ((LAYERS, SHADE), lambda: _traced(case, effects)),
        ((LAW, BAND), lambda: _exact(case, effects)),
        ((VECTORS,), lambda: _vectorial(case)),
        ((SPECTRUM,), lambda: _coloured(case)),
        ((WALLS,), lambda: _walls(case, bodies)),
        ((FINISH,), lambda: _finish(case, bodies)),
        ((UNKNOWN,), lambda: _unstated(case, wavefront)),
        ((HALO,), lambda: _with_halo(case)),
    )
    wanted = (make() for names, make in rows if any(n in effects for n in names))
    return tuple(found for found in wanted if found is not None)


def _traced(case: LookCase, effects: Collection[str]) -> BetterModel | None:
    """Return the look with bodies that hide and shade ray by ray."""
    named = tuple(name for name in (LAYERS, SHADE) if name in effects)
    if SHADE in named and case.lamp_aperture is None:
        named = tuple(name for name in named if name != SHADE)
    if not named:
        return None
    plain = flat(as_tried(case))
    return BetterModel(
        effects=named,
        by="rays that bodies hide and shade one by one",
        ends=(ImageModel(cases=((1.0, plain),), is_traced=True),),
        against=plain,
    )


def flat(case: LookCase) -> LookCase:
    """Return a look with bodies that are dull faces, as most models have them."""

    def faces(layers: tuple[Layer, ...]) -> tuple[Layer, ...]:
        return tuple(
            replace(layer, underside_um=None, wall_reflectance=0.0, finish=0.0)
            for layer in layers
        )

    return replace(case, static=faces(case.static), moving=faces(case.moving))


def _exact(case: LookCase, effects: Collection[str]) -> BetterModel:
    """Return the look by the exact law with all of its band."""
    plain = _blended(case)
    whole = replace(Sampling(), rays=plain.sampling.rays)
    better = replace(plain, model="exact", sampling=whole)
    return BetterModel(
        effects=tuple(name for name in (LAW, BAND) if name in effects),
        by="the exact law with its whole band",
        ends=(ImageModel(cases=((1.0, better),)),),
        against=plain,
    )


def _vectorial(case: LookCase) -> BetterModel:
    """Return the look by a vectorial field, as a sum of two scalar ones."""
    # terms in waves belong to the whole pupil
    plain = _seen_by(_blended(case), wavefront=(), halo=None)
    scope = plain.microscope
    inner = replace(scope, aperture=_INNER * scope.aperture)
    weight = inner_weight(scope.aperture / scope.medium_index)
    cases = ((1 - weight, plain), (weight, replace(plain, microscope=inner)))
    return BetterModel(
        effects=(VECTORS,),
        by="unpolarised light as a vector field",
        ends=(ImageModel(cases=cases),),
        against=plain,
    )


@lru_cache(maxsize=16)
def inner_weight(sine: float) -> float:
    """Return the weight of the inner aperture's scalar field in a vectorial one.

    The rest is the whole aperture's; `sine` is that of the largest angle to the axis.
    """
    x = (np.arange(_FREQUENCIES) + 0.5) / _FREQUENCIES
    scalar = diffraction(x)
    column = diffraction(x / _INNER) - scalar
    return float(column @ (vectorial_otf(x, sine) - scalar) / (column @ column))


def _coloured(case: LookCase) -> BetterModel:
    """Return the look in a flat band of wavelengths."""
    nodes, weights = np.polynomial.legendre.leggauss(_COLOURS)
    plain, mean = _blended(case), case.microscope.wavelength_um
    colours = (mean * (1 + FLAT_BAND / 2 * nodes)).tolist()
    cases = tuple(
        (float(weight) / 2, _in_colour(plain, colour))
        for colour, weight in zip(colours, weights, strict=True)
    )
    return BetterModel(
        effects=(SPECTRUM,),
        by=f"a flat band of {FLAT_BAND:.0%}",
        ends=(ImageModel(cases=cases),),
        against=plain,
    )


def _in_colour(case: LookCase, wavelength_um: float) -> LookCase:
    """Return a look in another colour; the lens' error in um is the same."""
    scope = case.microscope
    waves = scope.wavelength_um / wavelength_um
    terms = tuple((noll, waves * rms) for noll, rms in scope.wavefront)
    return _seen_by(case, wavelength_um=wavelength_um, wavefront=terms)


def _unstated(case: LookCase, stated: WavefrontSpec) -> BetterModel:
    """Return the look with each term of coma and trefoil that may be there."""
    plain = _blended(case)
    return BetterModel(
        effects=(UNKNOWN,),
        by="a pupil with coma along x and y, and with trefoil",
        ends=tuple(_through(plain, each) for each in unknown_wavefronts(stated)),
        against=plain,
        is_either_way=True,
    )


def _with_halo(case: LookCase) -> BetterModel:
    """Return the look without a halo and with most of what one may be."""
    plain = _blended(case)
    return BetterModel(
        effects=(HALO,),
        by="a Gaussian halo",
        ends=tuple(
            ImageModel(cases=((1.0, _seen_by(plain, halo=halo)),))
            for halo in halo_ends(plain.microscope)
        ),
        against=plain,
    )


def _through(case: LookCase, wavefront: Terms) -> ImageModel:
    """Return a look through a lens with a wavefront error."""
    return ImageModel(cases=((1.0, _seen_by(case, wavefront=wavefront)),))


def _seen_by(case: LookCase, **changed: Any) -> LookCase:
    """Return a look through another lens."""
    return replace(case, microscope=replace(case.microscope, **changed))


def _blended(case: LookCase) -> LookCase:
    """Return a look that is blended from layers alone: rays know no waves.

    What rays add is nearly the same through both lenses.
    """
    plain = flat(case)
    if case.treatment == "occluded":
        plain = replace(plain, treatment="joint")
    return replace(plain, sampling=replace(plain.sampling, rays=0.0))


def _walls(case: LookCase, bodies: Sequence[Body]) -> BetterModel:
    """Return the look with solid bodies, walls at both ends of what they reflect."""
    made, tried = by_layer(bodies), as_tried(case)
    return BetterModel(
        effects=(WALLS,),
        by="solid bodies, their walls as dark and as bright as they may be",
        ends=_ends(tried, lambda layer, end: _solid(layer, made, end)),
        against=tried,
        alternates=True,
        is_drawn=bool(case.surfaces),
    )


def _finish(case: LookCase, bodies: Sequence[Body]) -> BetterModel:
    """Return the look with faces as dull and as much of mirrors as they may be."""
    made, tried = by_layer(bodies), as_tried(case)
    return BetterModel(
        effects=(FINISH,),
        by="faces that are dull, and that are mirrors",
        ends=_ends(tried, lambda layer, end: _polished(layer, made, end)),
        against=tried,
        alternates=True,
        is_drawn=bool(case.surfaces),
    )


def _solid(layer: Layer, made: Mapping[str, Body], end: int) -> Layer:
    body = made.get(layer.name)
    if body is None or body.z_low_um >= layer.z_um:
        return layer
    wall = body.surface.wall[end]
    return replace(layer, underside_um=body.z_low_um, wall_reflectance=wall)


def _polished(layer: Layer, made: Mapping[str, Body], end: int) -> Layer:
    body = made.get(layer.name)
    return layer if body is None else replace(layer, finish=body.surface.finish[end])


def _ends(
    case: LookCase, changed: Callable[[Layer, int], Layer]
) -> tuple[ImageModel, ...]:
    """Return the look at both ends of an interval; one where they are the same."""
    found = tuple(
        replace(
            case,
            static=tuple(changed(layer, end) for layer in case.static),
            moving=tuple(changed(layer, end) for layer in case.moving),
        )
        for end in (0, 1)
    )
    one, other = (ImageModel(cases=((1.0, each),)) for each in found)
    return (one,) if one == other else (one, other)
