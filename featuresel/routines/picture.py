"""Whether an array is an image that a routine can look at."""

from __future__ import annotations

from microplan.arrays import FloatArray
from microplan.featuresel.routines.contract import Failure

# Full scale is 1, and no correction of dark or uneven light comes near this. Squares of
# it, summed over any frame, are still far from the end of single precision.
_MOST = 1e3


def refused(image: FloatArray) -> Failure | None:
    """Return why no routine can look at `image`, None if one can.

    Parameters
    ----------
    image : (rows, columns) float array
        0..1 of full scale, or a little beyond.

    Returns
    -------
    Failure or None
        "no_image" of what has no pixels, or one that is not a number near that range:
        sums over it would be endless, or nan, and would raise or compare as anything.
    """
    if image.ndim != 2 or image.size == 0:
        return Failure(code="no_image", message=f"an image of shape {image.shape}")
    low, high = float(image.min()), float(image.max())  # nan if a pixel is
    if low >= -_MOST and high <= _MOST:
        return None
    return Failure(
        code="no_image",
        message=f"pixels from {low:.3g} to {high:.3g}, full scale is 1",
    )
