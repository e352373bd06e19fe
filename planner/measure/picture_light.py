"""Light of pictures from their counts, and what is wrong with it."""

from __future__ import annotations

from typing import cast

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.lens.sensor import CountArray, Sensor, linear

SHALLOW = (10, 12, 14)  # bits that cameras have and programs keep in files of 16
MOST_FULL = 0.05  # of a region's pixels at full scale: more hide edges


def full_scale(most: float, file_bits: int, camera_bits: int, bits: int | None) -> int:
    """Return the count of full light of a picture.

    Parameters
    ----------
    most : float
        The largest count in the picture.
    file_bits : int
        8 or 16, of the file's pixels.
    camera_bits : int
        Of the task's camera.
    bits : int, optional
        What a user states.
    """
    if bits is not None:
        return int(2**bits - 1)
    camera = int(2**camera_bits - 1)
    if file_bits == 16 and camera_bits > 8 and most <= camera:
        return camera
    return int(2**file_bits - 1)


def light(counts: FloatArray, full: int, sensor: Sensor) -> FloatArray:
    """Return the light, 0..1 of full scale, of counts (rows, columns) 0..`full`."""
    scaled = counts * (sensor.top_count / full)
    # not rounded to the camera's counts: a file may have finer ones
    return linear(cast(CountArray, scaled), sensor)


def no_light(
    counts: FloatArray, region: FloatArray, full: int
) -> tuple[str, str] | None:
    """Return why a picture has no light, and what to do; None if it has.

    `counts` are (rows, columns) of all of it, `region` those of its region.
    """
    most = float(counts.max())
    if most > full:
        return (f"it holds {most:.0f}, full scale is {full}", "state it with --bits")
    if not region.any():
        return ("its region is all black", "open the shutter, or expose longer")
    return None


def doubtful_light(counts: FloatArray, full: int) -> tuple[str, str] | None:
    """Return what makes the light of a region (rows, columns) doubtful, if anything.

    With what to do about it.
    """
    share = float(np.mean(counts >= full))
    if share > MOST_FULL:
        return (
            f"{100 * share:.0f} % of its region is at full scale, {full}",
            f"expose less: at most {100 * MOST_FULL:.0f} % may be",
        )
    most = float(counts.max())
    bits = next((b for b in SHALLOW if most < 2**b), None)
    if full == 2**16 - 1 and bits is not None:
        return (
            f"it holds at most {most:.0f} of {full}",
            f"if its full scale is {bits} bits, say --bits {bits}",
        )
    return None
