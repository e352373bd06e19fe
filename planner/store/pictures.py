"""Images as 8-bit pictures with the hash of their pixels."""

from __future__ import annotations

import hashlib

import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray

Picture = npt.NDArray[np.uint8]


def picture(image: FloatArray) -> Picture:
    """Return an image, (rows, columns) in 0..1, as 8 bit, rounded and clipped."""
    scaled: Picture = np.clip(np.rint(image * 255), 0, 255).astype(np.uint8)
    return scaled


def picture_sha256(pixels: Picture) -> str:
    """Return the hash of an image's size and decoded pixels."""
    rows, columns = pixels.shape
    digest = hashlib.sha256(f"{rows}x{columns}:".encode())
    digest.update(np.ascontiguousarray(pixels).tobytes())
    return digest.hexdigest()
