"""Bodies above a mirror face, unfolded: mirrored in its plane.

A ray goes on straight through the mirror, and past images of the bodies that the true
one passes on its way to the lamp.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from microplan.arrays import Float32Array
from microplan.optics.layers.solids.straight_rays import Rays, ThickBody, covers, hides


def unfolded(bodies: Sequence[ThickBody], z_um: float) -> list[ThickBody]:
    """Return the images of bodies that rise above a mirror at a height.

    One that stands beside the mirror is met sharply there.
    """
    return [
        replace(
            body,
            top_um=2 * z_um - max(body.under_um, z_um),
            under_um=2 * z_um - body.top_um,
            is_sharp=body.under_um <= z_um,
        )
        for body in bodies
        if body.top_um > z_um
    ]


def free_of(
    images: Sequence[ThickBody], rays: Rays, soft: float, *, walls: bool
) -> Float32Array:
    """Return what images leave of each ray, (points, slopes), 0..1.

    With their walls, or as the flat faces that the bodies' tops are.
    """
    found = np.ones((rays.x_um.size, rays.across.size), dtype=np.float32)
    for body in images:
        if walls and body.under_um < body.top_um:
            found *= 1 - hides(
                body, rays, soft, from_um=body.top_um, to_um=body.under_um
            )
        else:
            found *= 1 - covers(replace(body, top_um=body.under_um), rays, soft)
    return found
