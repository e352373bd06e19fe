"""What stands before or beside a target where it was not planned, as a few images.

Its place is known to some um and its angle may be any, while its blur is wide: what it
then changes is a sum of few images, the principal ones of its covariance. A fit that
frees their amounts learns from the image where what stands in front really is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import LookModel

_FAINTEST = 0.5  # of what noise makes of it in all pixels: less moves no answer as far
_MOST = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class SwayMaps:
    """Changes by one standard deviation each of independent amounts of mean 0."""

    light: FloatArray  # (S, rows, columns)
    through: FloatArray  # (S, rows, columns)


def sway_maps(model: LookModel, image: FloatArray) -> SwayMaps:
    """Return what likely errors of what stands still change, none if that is nothing.

    Parameters
    ----------
    model : LookModel
        The look.
    image : (rows, columns) float array
        The nominal image.

    """
    changes = model.occluder_modes()
    if not changes:
        none = np.zeros((0, *image.shape))
        return SwayMaps(light=none, through=none)
    shown = np.stack([change.shown for change in changes])
    through = np.stack([change.through for change in changes])
    kept = principal(shown / np.sqrt(model.camera.variance(image)))
    through = np.tensordot(kept, through, 1)
    light = np.tensordot(kept, shown, 1) - through * model.alone()
    return SwayMaps(light=light, through=through)


def principal(changes: FloatArray) -> FloatArray:
    """Return the few sums of changes that matter, as weights of theirs.

    Parameters
    ----------
    changes : (C, rows, columns) float array
        Of an image over its pixels' noise, by one standard deviation each of C
        independent amounts.

    Returns
    -------
    (S, C) float64 array
        Rows of weights, the strongest first. The sums that they make are again of one
        standard deviation of S independent amounts: with D = U S V^T the covariance is
        D^T D, and row k of S V^T is U^T D (Karhunen and Loeve).
    """
    mix, strength, _ = np.linalg.svd(
        changes.reshape(len(changes), -1), full_matrices=False
    )
    kept = mix[:, :_MOST][:, strength[:_MOST] > _FAINTEST].T
    largest = np.abs(kept).argmax(axis=1)[:, None]
    signed: FloatArray = kept * np.sign(np.take_along_axis(kept, largest, axis=1))
    return signed  # whose signs are free else
