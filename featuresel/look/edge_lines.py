"""Images of a look whose rounded edges mirror a ring of light from elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.routines.contract import LookModel
from microplan.optics.light.mirrored_strip import light_range
from microplan.optics.render.scene import Layer

_PLACES = (0.0, 0.5, 1.0)  # within the rounding


def line_images(
    case: LookCase, render: Callable[[LookCase], LookModel]
) -> tuple[FloatArray, ...]:
    """Return the look with lines at both ends of their roundings, bright and faint.

    Images are (rows, columns), 0..1 of full scale. The target's lines and those of what
    is around it change apart. There are none where no edge may be a line. Lines are as
    faint and as bright as the look's ring makes those of roundings that are no circles
    (`microplan.optics.light.mirrored_strip.light_range`).

    Parameters
    ----------
    case : LookCase
        The look as it is planned.
    render : callable
        Returns the renderer of a look.
    """
    found: list[FloatArray] = []
    if case.ring is None:
        return ()
    scope = case.microscope
    shares = light_range(case.ring, scope.aperture / scope.medium_index)
    for bare in _bare(case):
        usual = render(bare)()
        stays = any(layer.edge_line for layer in (*bare.moving, *bare.static))
        for line in _PLACES:
            # lines that stay are the same in both
            dull = render(replace(bare, line=line))() if stays else usual
            change = render(replace(case, line=line))() - dull
            found += [np.clip(usual + share * change, 0, 1) for share in shares]
    return tuple(found)


def _bare(case: LookCase) -> Iterator[LookCase]:
    """Yield the look without the target's lines, and without all others."""
    if any(layer.edge_line for layer in case.moving):
        yield replace(case, moving=_dull(case.moving))
    if any(layer.edge_line for layer in case.static):
        yield replace(case, static=_dull(case.static))


def _dull(layers: tuple[Layer, ...]) -> tuple[Layer, ...]:
    return tuple(replace(layer, edge_line=None) for layer in layers)
