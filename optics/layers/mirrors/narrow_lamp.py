"""Mirrors under a lamp that fills less of the pupil than the lens.

A mirror sends back along a slope what the lamp sends along the mirrored one: the lens
sees it dark beyond the lamp's cone, and as much brighter within, as walls keep a ray's
slope. So what mirrors send is an image in a microscope whose lit rays are the lamp's,
what dull faces send is one through the whole pupil, and both are added.
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
    scene: Scene,
    microscope: Microscope,
    lamp_aperture: float | None,
    *,
    also: Sequence[Covered] = (),
    blurred: Blurring,
) -> tuple[LitPart, ...]:
    """Return scenes whose images add up to that of a scene in coaxial light.

    The scene itself, where no mirror sees the lamp's rim: then dull faces first, and
    mirrors over black. A mirror that nothing shades is as bright as a dull face then,
    and out of focus less blurred; its transfer is that of
    `microplan.optics.transfer.lamp_limited`.

    Parameters
    ----------
    lamp_aperture : float, optional
        None: the light does not come through the objective.
    also : sequence of Covered
        More layers of the scene, blurred.
    blurred : callable
        Blurs them as they were, by another microscope.
    """
    layers = [c.layer for c in also]
    if lamp_aperture is None or not _splits(
        (*scene.layers, *layers), microscope, lamp_aperture
    ):
        return (LitPart(scene=scene, microscope=microscope, also=also),)
    narrow = replace(microscope, lamp_aperture=lamp_aperture)
    dull = replace(scene, layers=tuple(map(_dull, scene.layers)))
    shiny = replace(scene, layers=tuple(map(_shiny, scene.layers)), background=0.0)
    return (
        LitPart(
            scene=dull,
            microscope=microscope,
            also=[replace(c, layer=_dull(c.layer)) for c in also],
        ),
        LitPart(
            scene=shiny,
            microscope=narrow,
            also=blurred([_shiny(layer) for layer in layers], narrow),
        ),
    )


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
