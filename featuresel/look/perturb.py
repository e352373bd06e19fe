"""Perturbed images of a look: any trial, with the static scene in it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.look.design import Trial
from microplan.featuresel.look.discrepancy import drawn
from microplan.featuresel.look.scenario import (
    Backdrop,
    LookCase,
    UnknownRotation,
    moved_layers,
    render_look,
)
from microplan.featuresel.look.static_layers import (
    displaced,
    fresh,
    standing,
    usual_range,
)
from microplan.featuresel.look.unknown_surfaces import drawn_surfaces, unknown_bodies
from microplan.optics.lens.sensor import ROUNDING, CountArray, Sensor, expose, linear
from microplan.optics.outline.outline import place
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Layer
from microplan.optics.render.view_range import Range

# `microplan.optics.render.sampling.Sampling.rays` of trials: images differ from those
# of all rays by less than a third of what walls change (tested), and take a fraction of
# the time.
RAYS = 0.5
_FLAT = 0.7  # of pairs of images that charge for walls, where trials draw none
# `Sampling.walls` of trials whose focus lies in the target's body, so many depths of
# field, n wavelength / A^2, below its top: what its walls hide beside it changes within
# a few um there, and chains find edges where points are too far apart (tested)
_CLOSE, _BELOW = 3.0, 2.0


def image(
    case: LookCase,
    trial: Trial,
    backdrop: Backdrop | None = None,
    moved: tuple[Layer, ...] | None = None,
) -> FloatArray:
    """Return the trial's region as the camera gives it, (rows, columns), 0..1.

    The zoom error scales about the optical axis; the truth stays the target's world
    pose, so an estimator that trusts the nominal zoom errs by ratio x distance. Trials
    that differ in the target's pose, light and noise alone may share their `backdrop`.
    By default `moved` are the target's layers at its position; none if they are in it.
    """
    return linear(counts(case, trial, backdrop, moved), case.sensor)


def counts(
    case: LookCase,
    trial: Trial,
    backdrop: Backdrop | None = None,
    moved: tuple[Layer, ...] | None = None,
) -> CountArray:
    """Return the trial's region as the camera's counts, (rows, columns).

    Arguments as in `image`.
    """
    return exposed(case, trial, backdrop, moved)[0]


def exposed(
    case: LookCase,
    trial: Trial,
    backdrop: Backdrop | None = None,
    moved: tuple[Layer, ...] | None = None,
) -> tuple[CountArray, FloatArray]:
    """Return the counts of `counts`, and the discrepancy in them, (rows, columns) each.

    That is a share of full scale, on top of the modelled image.
    """
    seen = _perturbed(case, trial)
    behind = still(case, trial) if backdrop is None else backdrop
    if moved is None:
        moved = moved_layers(seen, trial.dx_um, trial.dy_um, trial.dtheta_rad)
    return pictured(seen, trial, render_look(seen, moved, behind))


def pictured(
    seen: LookCase, trial: Trial, image: FloatArray
) -> tuple[CountArray, FloatArray]:
    """Return the counts of a trial's image, and the discrepancy in them.

    Parameters
    ----------
    seen : LookCase
        The look as it is in the trial.
    trial : Trial
        Its seed draws discrepancy and noise.
    image : (rows, columns) float array
        Without either, 1 at full well.

    Returns
    -------
    (rows, columns) integer array, (rows, columns) float64 array
        Counts, and shares of full scale that are in them besides the image's.
    """
    rng = np.random.default_rng(np.random.SeedSequence(trial.seed))
    if seen.discrepancy is None:
        return expose(image, seen.sensor, rng), np.zeros_like(image)
    own = np.random.SeedSequence(trial.seed, spawn_key=(1,))  # the noise is another
    more = drawn(
        image,
        seen.discrepancy,
        seen.microscope.um_per_px,
        seen.reach_um,
        np.random.default_rng(own),
    )
    return expose(image + more, seen.sensor, rng), seen.sensor.gain * more


def still(case: LookCase, trial: Trial, reach: Range | None = None) -> Backdrop:
    """Return the static scene in a trial, blurred.

    Focus, zoom, law, lens and the occluder's place matter, the target's pose does not.
    Trials of one `reach` share the transforms; by default it is that of the design.
    """
    seen, reach = _perturbed(case, trial), reach or usual_range(case)
    focus_um, zoom, by_um = seen.focus_um, trial.magnification, trial.occluder_um
    if not seen.shares_still_layers or not reach.holds(focus_um, by_um, zoom):
        return fresh(seen, seen.static)
    found, left = Backdrop(), list(zip(case.static, seen.static, strict=True))
    for shift_um in dict.fromkeys((by_um, (0.0, 0.0))):  # the owner's stay
        group = [here for here, there in left if displaced(here, shift_um) == there]
        left = [pair for pair in left if pair[0] not in group]
        ready = standing(case, group, reach, trial.model) if group else None
        if ready is not None:
            own = ready.at(focus_um=focus_um, zoom=zoom, shift_um=shift_um)
            found = found.with_(own)
    return found.with_(fresh(seen, [there for _, there in left])) if left else found


def _perturbed(case: LookCase, trial: Trial) -> LookCase:
    """Return the look as it truly is in a trial, but for the target's pose."""
    case = _surfaced(case, trial)
    return replace(
        case,
        static=shifted(
            case.static,
            case.target.name.partition(".")[0],
            trial.occluder_um,
            tuple(zip(case.spread.turning, trial.turns_rad, strict=True))
            if trial.turns_rad  # a trial made elsewhere turns nothing
            else (),
        ),
        microscope=case.zoomed(trial.magnification),
        focus_um=case.focus_um + trial.dz_um,
        model=trial.model,
        light=case.lit(trial.gain, trial.gradient_x, trial.gradient_y),
        lens=case.lens if trial.lens is None else trial.lens,
        line=trial.line,
        sensor=noisier(case.sensor, trial.noise),
        sampling=sampling_at(case, case.focus_um + trial.dz_um, RAYS),
    )


def as_tried(case: LookCase) -> LookCase:
    """Return a look sampled as its trials are; with more rays where walls are flat."""
    rays = RAYS if case.surfaces else _FLAT
    return replace(case, sampling=sampling_at(case, case.focus_um, rays))


def sampling_at(case: LookCase, focus_um: float, rays: float) -> Sampling:
    """Return how a look's image is sampled at a focus, with a share of all rays."""
    below_um = focus_um + _BELOW * case.microscope.wave_depth_um
    is_within = any(
        layer.underside_um is not None
        and layer.underside_um < focus_um
        and below_um < layer.z_um
        for layer in case.moving
    )
    walls = _CLOSE if is_within and rays < 1 else None  # else there are many rays
    return replace(case.sampling, rays=rays, walls=walls, planes=0 < rays < 1)


def _surfaced(case: LookCase, trial: Trial) -> LookCase:
    """Return the look with walls and faces as they are in a trial."""
    if not trial.surfaces:
        return case
    bodies = unknown_bodies(case.surfaces)
    shares = dict(zip(bodies, trial.surfaces, strict=True))
    still, moving = (
        drawn_surfaces(layers, case.surfaces, shares)
        for layers in (case.static, case.moving)
    )
    return replace(case, static=still, moving=moving)


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
        noise=tuple(
            (count, max(variance - ROUNDING, 0.0) * factor**2 + ROUNDING)
            for count, variance in sensor.noise
        ),
    )
