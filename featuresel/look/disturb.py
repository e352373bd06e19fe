"""What trials change of a look besides the target's pose, focus, zoom and light."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from microplan.featuresel.look.scenario import UnknownRotation
from microplan.optics.lens.sensor import Sensor
from microplan.optics.outline.outline import place
from microplan.optics.render.scene import Layer


def shifted(
    layers: tuple[Layer, ...],
    owner: str,
    by_um: tuple[float, float],
    turns: Sequence[tuple[UnknownRotation, float]] = (),
) -> tuple[Layer, ...]:
    """Return the static scene, turned and moved as one where it is not the owner's.

    Parameters
    ----------
    layers : tuple of Layer
        In the world; a name's first word, before a dot, is whose it is.
    owner : str
        Whose layers stay.
    by_um : (x, y)
        How far the others move.
    turns : sequence of (UnknownRotation, rad)
        By how much some of them turn first.
    """
    return tuple(_moved(layer, owner, by_um, turns) for layer in layers)


def turned(
    layers: tuple[Layer, ...], what: UnknownRotation, turn_rad: float
) -> tuple[Layer, ...]:
    """Return layers with those of one owner turned about its point, rad."""
    return shifted(layers, "", (0.0, 0.0), ((what, turn_rad),))


def _moved(
    layer: Layer,
    owner: str,
    by_um: tuple[float, float],
    turns: Sequence[tuple[UnknownRotation, float]],
) -> Layer:
    """Return one layer as `shifted` has it: placed once, however often it turns."""
    whose = layer.name.partition(".")[0]
    x, y, theta = 0.0, 0.0, 0.0
    for what, turn_rad in turns:
        if what.owner == whose:
            c, s = math.cos(turn_rad), math.sin(turn_rad)
            dx, dy = x - what.x_um, y - what.y_um
            x, y = what.x_um + c * dx - s * dy, what.y_um + s * dx + c * dy
            theta += turn_rad
    if whose != owner:
        x, y = x + by_um[0], y + by_um[1]
    if (x, y, theta) == (0.0, 0.0, 0.0):
        return layer
    return replace(layer, outline=place(layer.outline, x, y, theta))


def noisier(sensor: Sensor, factor: float) -> Sensor:
    """Return the sensor with shot and read noise multiplied; rounding stays."""
    if factor == 1.0:
        return sensor
    return replace(
        sensor,
        # shot noise of full scale is 1 / sqrt(full well), read noise over full well
        full_well_e=sensor.full_well_e / factor**2,
        read_noise_e=sensor.read_noise_e / factor,
    )
