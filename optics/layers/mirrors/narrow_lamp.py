"""Mirrors under a lamp that fills less of the pupil than the lens.

A mirror sends back along a slope what the lamp sends along the mirrored one: the lens
sees it dark beyond the lamp's cone, and as much brighter within, as walls keep a ray's
slope. So what mirrors send is an image in a microscope whose lit rays are the lamp's,
what dull faces send is one through the whole pupil, and both are added. The first is
blurred as what absorbs over such a lamp: `microplan.optics.transfer.lamp_limited`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from microplan.optics.render.render import Covered
from microplan.optics.render.scene import Layer, Scene
from microplan.optics.transfer.microscope import Microscope

_EQUAL = 1e-9  # apertures that differ by less, as shares, are one

# Layers blurred as a microscope sees them
Blurring = Callable[[Sequence[Layer], Microscope], Sequence[Covered]]


@dataclass(frozen=True, slots=True, kw_only=True)
class LitPart:
    """What is seen by rays that are lit alike: all of a scene, or a share."""

    scene: Scene
    microscope: Microscope
    also: Sequence[Covered] = ()  # more layers of the scene


def lit_parts(
    whole: LitPart, lamp_aperture: float | None, blurred: Blurring
) -> tuple[LitPart, ...]:
    """Return scenes whose images add up to that of a scene in coaxial light.

    The scene itself, if no mirror sees beyond the lamp's cone: else dull faces, and
    then mirrors over black. A mirror that nothing shades is as bright as a dull face.

    Parameters
    ----------
    whole : LitPart
        The scene in the lens' microscope.
    lamp_aperture : float, optional
        None: the light does not come through the objective.
    blurred : Blurring
        Blurs other layers as those of `whole.also` were.
    """
    scene, layers = whole.scene, [c.layer for c in whole.also]
    if lamp_aperture is None or not _splits(
        (*scene.layers, *layers), whole.microscope, lamp_aperture
    ):
        return (whole,)
    dull = replace(
        whole,
        scene=replace(scene, layers=tuple(map(_dull, scene.layers))),
        also=[replace(c, layer=_dull(c.layer)) for c in whole.also],
    )
    narrow = replace(whole.microscope, lamp_aperture=lamp_aperture)
    mirrors = [_shiny(layer) for layer in layers]
    shiny = LitPart(
        scene=Scene(
            layers=tuple(map(_shiny, scene.layers)),
            background=0.0,
            background_z_um=scene.background_z_um,
        ),
        microscope=narrow,
        also=blurred(mirrors, narrow),
    )
    return dull, shiny


def _splits(
    layers: Iterable[Layer], microscope: Microscope, lamp_aperture: float
) -> bool:
    """Return whether mirrors are seen by fewer rays than dull faces."""
    is_narrow = lamp_aperture < microscope.cone_aperture * (1 - _EQUAL)
    return is_narrow and any(la.reflectance * la.finish > 0 for la in layers)


def _dull(layer: Layer) -> Layer:
    """Return a layer without what it sends as a mirror."""
    if layer.finish == 0:
        return layer
    return replace(
        layer, reflectance=layer.reflectance * (1 - layer.finish), finish=0.0
    )


def _shiny(layer: Layer) -> Layer:
    """Return a layer that sends what it does as a mirror alone; a dull one is black."""
    return replace(layer, reflectance=layer.reflectance * layer.finish, finish=1.0)
