"""Better models of a look's image, by the effect that they model better."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from microplan.featuresel.look.scenario import LookCase
from microplan.optics.coherence.unmodelled import FLAT_BAND, vectorial_otf
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Layer
from microplan.optics.transfer.otf import diffraction
from microplan.planner.assembly.assembly import Body

LAYERS, SHADE = "layers of different height", "shade of higher bodies"
LAW, BAND = "defocus law", "band and tile"
VECTORS, SPECTRUM = "vectorial field", "spectrum of the light"
WALLS, FINISH = "side walls", "finish of faces"
# It has an interval of its own in the lower bound: `PastMeasurement.coherence_um`.
CHARGED = ("partial coherence",)
# Shares of the aperture whose scalar transfer functions make up the vectorial one.
_APERTURES = (1.0, 0.95, 0.85)
_FREQUENCIES = 64
_COLOURS = 3  # Gauss nodes over the flat band


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageModel:
    """How an image is made: a weighted sum of looks, or rays through each pixel."""

    cases: tuple[tuple[float, LookCase], ...]
    is_traced: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class BetterModel:
    """A better model of some effects; two ends where only an interval is known."""

    effects: tuple[str, ...]  # rows of the ledger
    by: str  # in words
    ends: tuple[ImageModel, ...]
    # each end at half of the poses; else both at all of them
    alternates: bool = False


def better_models(
    case: LookCase, effects: Collection[str], bodies: Sequence[Body]
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
    """
    rows: tuple[tuple[tuple[str, ...], Callable[[], BetterModel | None]], ...] = (
        ((LAYERS, SHADE), lambda: _traced(case, effects)),
        ((LAW, BAND), lambda: _exact(case, effects)),
        ((VECTORS,), lambda: _vectorial(case)),
        ((SPECTRUM,), lambda: _coloured(case)),
        ((WALLS,), lambda: _walls(case, bodies)),
        ((FINISH,), lambda: _finish(case, bodies)),
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
    return BetterModel(
        effects=named,
        by="rays that bodies hide and shade one by one",
        ends=(ImageModel(cases=((1.0, case),), is_traced=True),),
    )


def _exact(case: LookCase, effects: Collection[str]) -> BetterModel:
    """Return the look by the exact law with all of its band."""
    better = replace(case, model="exact", sampling=Sampling())
    return BetterModel(
        effects=tuple(name for name in (LAW, BAND) if name in effects),
        by="the exact law with its whole band",
        ends=(ImageModel(cases=((1.0, better),)),),
    )


def _vectorial(case: LookCase) -> BetterModel:
    """Return the look by a vectorial field, as a sum of scalar ones.

    Scalar transfer functions of a few apertures add up to the vectorial one.
    """
    scope = case.microscope
    weights = vectorial_weights(scope.aperture / scope.medium_index)
    cases = tuple(
        (weight, replace(case, microscope=replace(
            scope, aperture=share * scope.aperture)))
        for share, weight in zip(_APERTURES, weights, strict=True)
    )  # fmt: skip
    return BetterModel(
        effects=(VECTORS,),
        by="unpolarised light as a vector field",
        ends=(ImageModel(cases=cases),),
    )


@lru_cache(maxsize=16)
def vectorial_weights(sine: float) -> tuple[float, ...]:
    """Return weights of scalar transfer functions that make up a vectorial one.

    Of the apertures' shares 1, .95 and .85; their sum is 1. `sine` is the aperture over
    the index.
    """
    x = (np.arange(_FREQUENCIES) + 0.5) / _FREQUENCIES
    columns = np.stack([diffraction(x / share) for share in _APERTURES], axis=1)
    # the sum is 1: the last is what the others leave
    wanted = vectorial_otf(x, sine) - columns[:, -1]
    free, *_ = np.linalg.lstsq(columns[:, :-1] - columns[:, -1:], wanted, rcond=None)
    return (*(float(weight) for weight in free), 1.0 - float(free.sum()))


def _coloured(case: LookCase) -> BetterModel:
    """Return the look in a flat band of wavelengths."""
    nodes, weights = np.polynomial.legendre.leggauss(_COLOURS)
    mean = case.microscope.wavelength_um
    cases = tuple(
        (
            float(weight) / 2,
            replace(case, microscope=replace(
                case.microscope,
                wavelength_um=float(mean * (1 + FLAT_BAND / 2 * node)))),
        )
        for node, weight in zip(nodes, weights, strict=True)
    )  # fmt: skip
    return BetterModel(
        effects=(SPECTRUM,),
        by=f"a flat band of {FLAT_BAND:.0%}",
        ends=(ImageModel(cases=cases),),
    )


def _walls(case: LookCase, bodies: Sequence[Body]) -> BetterModel:
    """Return the look with solid bodies, walls at both ends of what they reflect."""
    made = by_layer(bodies)
    return BetterModel(
        effects=(WALLS,),
        by="solid bodies, their walls as dark and as bright as they may be",
        ends=_ends(case, lambda layer, end: _solid(layer, made, end)),
        alternates=True,
    )


def _finish(case: LookCase, bodies: Sequence[Body]) -> BetterModel:
    """Return the look with faces as dull and as much of mirrors as they may be."""
    made = by_layer(bodies)
    return BetterModel(
        effects=(FINISH,),
        by="faces that are dull, and that are mirrors",
        ends=_ends(case, lambda layer, end: _polished(layer, made, end)),
    )


def by_layer(bodies: Sequence[Body]) -> Mapping[str, Body]:
    """Return the body of each layer by its name, that of a mark is what it lies on."""
    return {
        name: body
        for body in bodies
        for name in (body.name, *(mark for mark, *_ in body.marks))
    }


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
    return tuple(ImageModel(cases=((1.0, each),)) for each in dict.fromkeys(found))
