"""Changes of an image by walls and faces that are not known, as maps of the region.

A change is light that stays where the body is whose wall sends it, or moves with the
target, and a share of the target's own light: what hides it is smooth, its edges are
where the target is. So maps that do not move show it at any place of the target.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import LookModel, SurfaceChange, Target

_FAINTEST = 0.5  # of what noise makes of it in all pixels: less moves no answer as far
# What is out of focus is even over so many pixels: shares are pooled over them.
_EVEN_PX = 1.5
_DOUBT = 0.002  # of full scale: where the target varies less, nothing is known
_PLANE = 5  # places, from which on the light may change with the place


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceMaps:
    """Change = amount x (light + place x moved + through x target alone)."""

    light: FloatArray  # (S, rows, columns)
    through: FloatArray  # (S, rows, columns)
    moved: FloatArray  # (S, 2, rows, columns) by the target's place, per px
    far_px: float  # beyond such a displacement `moved` is that of it


def surface_maps(
    model: LookModel, target: Target, image: FloatArray
) -> SurfaceMaps | None:
    """Return the changes by surfaces that are not known, None where nothing shows.

    Parameters
    ----------
    model : LookModel
        The look.
    target : Target
        What is to be found.
    image : (rows, columns) float array
        The nominal image.
    """
    changes = model.surface_changes()
    if not changes:
        return None
    k, noise = target.px_per_um, np.sqrt(model.camera.variance(image))
    places = {at for each in changes for at in each.places_um}
    alone_at = {(x, y): model.alone(dx_um=x, dy_um=y) for x, y in sorted(places)}
    parts = [_Part.of(each, alone_at, k) for each in changes]
    for each, part in zip(changes, tuple(parts), strict=True):
        if each.is_still:
            parts += part.displaced(each.body_sigma_um * k)
    alone = model.alone()
    shows = [
        float(np.linalg.norm((part.light + part.through * alone) / noise)) > _FAINTEST
        for part in parts
    ]
    kept = [part for part, is_seen in zip(parts, shows, strict=True) if is_seen]
    if not kept:
        return None
    return SurfaceMaps(
        light=np.stack([part.light for part in kept]),
        through=np.stack([part.through for part in kept]),
        moved=np.stack([part.moved for part in kept]),
        far_px=2 * k * max(max(map(abs, at)) for c in changes for at in c.places_um),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Part:
    """The maps of one change."""

    light: FloatArray  # (rows, columns)
    through: FloatArray  # (rows, columns)
    moved: FloatArray  # (2, rows, columns)

    @classmethod
    def of(
        cls,
        change: SurfaceChange,
        alone_at: Mapping[tuple[float, float], FloatArray],
        px_per_um: float,
    ) -> _Part:
        """Return maps of a change by least squares over the places of the target.

        `alone_at` has images of the target alone there. Where the change stays with
        other bodies its light is a plane over the places.
        """
        places = px_per_um * np.array(change.places_um) * [1, -1]
        still = np.ones((len(places), 1))
        if change.is_still and len(places) >= _PLANE:
            still = np.concatenate((still, places), axis=1)
        inverse = np.linalg.pinv(still)
        rest = np.eye(len(places)) - still @ inverse
        alone = np.stack([alone_at[at] for at in change.places_um])
        off, shown = np.tensordot(rest, alone, 1), np.tensordot(rest, change.shown, 1)
        through = _pooled((off * shown).sum(axis=0)) / (
            _pooled((off**2).sum(axis=0)) + len(places) * _DOUBT**2
        )
        light = np.tensordot(inverse, change.shown - through * alone, 1)
        moved = light[1:] if len(light) > 1 else np.zeros((2, *through.shape))
        return cls(light=light[0], through=through, moved=moved)

    def displaced(self, sigma_px: float) -> list[_Part]:
        """Return what errors of the bodies' position change, along columns and rows.

        A body displaced by a pixel is a target displaced by one the other way, in an
        image that is displaced by one.
        """
        if sigma_px == 0:
            return []
        none = np.zeros_like(self.moved)
        return [
            _Part(
                light=sigma_px * (_by_one(self.light - moved, axis) - self.light),
                through=sigma_px * (_by_one(self.through, axis) - self.through),
                moved=none,
            )
            for axis, moved in zip((1, 0), self.moved, strict=True)
        ]


def _pooled(values: FloatArray) -> FloatArray:
    """Return means over what is even, (rows, columns)."""
    return np.asarray(cv2.GaussianBlur(values, (0, 0), _EVEN_PX))


def _by_one(values: FloatArray, axis: int) -> FloatArray:
    """Return a map displaced by a pixel to the right or down; its border stays."""
    first = np.take(values, [0], axis=axis)
    rest = np.take(values, range(values.shape[axis] - 1), axis=axis)
    return np.concatenate((first, rest), axis=axis)
