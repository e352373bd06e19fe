"""Sheets of traced layers with what they send back as mirrors apart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from microplan.optics.layers.mirrors.images import mirror_images
from microplan.optics.layers.rays import LayerSheet
from microplan.optics.render.scene import Layer


def polished(layers: Sequence[Layer]) -> tuple[Layer, ...]:
    """Return layers that send back what theirs do as mirrors; none if none does."""
    if all(layer.finish == 0 for layer in layers):
        return ()
    return tuple(
        replace(layer, reflectance=layer.reflectance * layer.finish) for layer in layers
    )


def with_mirrors(
    stack: Sequence[LayerSheet],
    mirrors: Sequence[LayerSheet],
    layers: Sequence[Layer],
    image_sheets: Callable[[Sequence[Layer]], Sequence[LayerSheet]],
) -> list[LayerSheet]:
    """Return sheets that are dull, with their mirrors and images of higher layers.

    Parameters
    ----------
    stack : sequence of LayerSheet
        Of `layers`.
    mirrors : sequence of LayerSheet
        Of `polished` layers; none: no sheet changes.
    image_sheets : callable
        Makes sheets of images, on grids as those of the stack.
    """
    if not mirrors:
        return list(stack)
    found = []
    for sheet, mirror in zip(stack, mirrors, strict=True):
        black = [
            replace(image, reflectance=0.0)
            for group in mirror_images(layers, sheet.z_um)
            for image in group
        ]
        if not mirror.sends.any() or not black:
            found.append(sheet)
            continue
        found.append(
            replace(
                sheet,
                sends=sheet.sends - mirror.sends,
                mirrors=mirror.sends,
                images=tuple(image_sheets(black)),
            )
        )
    return found
