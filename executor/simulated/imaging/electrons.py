"""Counts of a camera: photon noise, read noise, rounding."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray


def counted(
    image: FloatArray,
    *,
    full_well_e: float,
    read_noise_e: float,
    bits: int,
    rng: np.random.Generator,
) -> npt.NDArray[np.uint8] | npt.NDArray[np.uint16]:
    """Return what the converter makes of an image.

    Parameters
    ----------
    image : (rows, columns) float array
        Share of full scale, 1 being `full_well_e` electrons.
    full_well_e, read_noise_e : float
        Electrons at full scale, and rms of the readout.
    bits : int
        1 to 16.
    rng : Generator
        Of the noise.

    Returns
    -------
    (rows, columns) array
        uint8 up to 8 bits, else uint16; clipped at both ends.
    """
    if not 1 <= bits <= 16:
        raise ValueError(f"bits must be 1 to 16, got {bits}")
    electrons = rng.poisson(full_well_e * np.maximum(image, 0.0)).astype(float)
    electrons += rng.normal(0.0, read_noise_e, image.shape)
    top = 2**bits - 1
    counts = np.clip(np.rint(electrons * (top / full_well_e)), 0, top)
    made: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
    made = counts.astype(np.uint8) if bits <= 8 else counts.astype(np.uint16)
    return made
