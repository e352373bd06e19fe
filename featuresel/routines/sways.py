"""What stands before or beside a target where it was not planned, as a few images.

Its place is known to some um and its angle may be any, while its blur is wide: what it
then changes is a sum of few images, the principal ones of its covariance. A fit that
frees their amounts learns from the image where what stands in front really is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from featuresel.routines import FloatArray, LookModel

_FAINTEST = 0.5  # of what noise makes of it in all pixels: less moves no answer as far
_MOST = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class SwayMaps:
    """Changes of light and of the share let through, by one standard deviation each.

    The principal ones of independent amounts of mean 0, strongest first.
    """

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

    Notes
    -----
    With the rows of D the changes that `LookModel.sways` names over the pixels' noise,
    the covariance of the image is D^T D = V S^2 V^T. Row k of S V^T is of one standard
    deviation of an amount of its own, whatever D's rows were (Karhunen and Loeve).
    """
    changes = model.sways()
    if not changes:
        none = np.zeros((0, *image.shape))
        return SwayMaps(light=none, through=none)
    shown = np.stack([change.shown for change in changes])
    through = np.stack([change.through for change in changes])
    noise = np.sqrt(model.camera.variance(image))
    mix, strength, _ = np.linalg.svd(
        (shown / noise).reshape(len(shown), -1), full_matrices=False
    )
    kept = mix[:, :_MOST][:, strength[:_MOST] > _FAINTEST].T
    largest = np.abs(kept).argmax(axis=1)[:, None]
    kept = kept * np.sign(np.take_along_axis(kept, largest, axis=1))  # else free
    through = np.tensordot(kept, through, 1)
    light = np.tensordot(kept, shown, 1) - through * model.alone()
    return SwayMaps(light=light, through=through)
