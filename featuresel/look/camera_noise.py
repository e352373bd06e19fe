"""Noise of a look's camera, as routines and limits count it."""

from __future__ import annotations

import numpy as np

from microplan.featuresel.routines.contract import CameraNoise
from microplan.optics.lens.sensor import Sensor, ends, noise_rows


def camera_noise(sensor: Sensor, fill_factor: float) -> CameraNoise:
    """Return a sensor's noise; its gain makes full scale a part of its well."""
    floor, ceiling = ends(sensor)
    return CameraNoise(
        full_well_e=sensor.full_well_e / sensor.gain,
        read_noise_e=sensor.read_noise_e,
        bits=sensor.bits,
        fill_factor=fill_factor,
        table=None if sensor.is_plain else np.transpose(noise_rows(sensor)),
        floor=floor,
        ceiling=ceiling,
    )
