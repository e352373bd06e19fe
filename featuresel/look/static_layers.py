"""Layers transformed once for many images: focus, zoom and position change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from microplan.featuresel.look.scenario import Backdrop, LookCase
from microplan.optics.layers.coaxial_light import Irradiance, irradiances
from microplan.optics.layers.wide_blur import cover_few
from microplan.optics.outline.outline import place
from microplan.optics.render.prepared_scene import PreparedScene, prepare
from microplan.optics.render.render import Covered
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Layer, Scene, Window
from microplan.optics.render.view_range import Range
from microplan.optics.transfer.microscope import Microscope

CUT = 3.0  # normal spreads of trials end here: they stand for a working station
_HELD = 8  # groups of layers: those of a look, under two laws


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """Layers ready for the images of a range, and the light under them."""

    prepared: PreparedScene
    lights: tuple[Irradiance, ...] | None  # None: nothing is shaded

    def at(
        self,
        *,
        focus_um: float,
        zoom: float = 1.0,
        shift_um: tuple[float, float] = (0.0, 0.0),
    ) -> Backdrop:
        """Return the layers as one image has them, all displaced by `shift_um`."""
        ready, frame = self.prepared, self.prepared.window
        found = ready.patches(focus_um=focus_um, shift_um=shift_um, zoom=zoom)
        covered = []
        for layer in ready.scene.layers:
            coverage = np.zeros((frame.rows, frame.columns))
            for patch in found:
                if patch.layer is layer:
                    coverage[patch.rows, patch.columns] = patch.coverage
            covered.append(Covered(layer=displaced(layer, shift_um), coverage=coverage))
        under = None
        if self.lights is not None:
            under = tuple(light.displaced(shift_um) for light in self.lights)
        return Backdrop(tuple(covered), under)


def usual_range(case: LookCase) -> Range:
    """Return the focus heights, zooms and displacements that a look's trials have.

    Targets are displaced as far as they are sought.
    """
    spread = case.spread
    off_um, ratio = CUT * spread.focus_sigma_um, CUT * spread.magnification_sigma
    return Range(
        focus_um=(case.focus_um - off_um, case.focus_um + off_um),
        zoom=(1 - ratio, 1 + ratio),
        shift_um=max(CUT * spread.occluder_sigma_um, spread.search_um),
    )


def standing(
    case: LookCase,
    layers: Sequence[Layer],
    reach: Range,
    model: str,
    *,
    keep: bool = True,
) -> Standing | None:
    """Return layers of a look ready for images of a range.

    Parameters
    ----------
    case : LookCase
        The look; its nominal zoom is that of the range's 1.
    layers : sequence of Layer
        In the world; with the rest of the case's they make its scene.
    reach : Range
        Focus heights, zooms and displacements that will be asked for.
    model : str
        The defocus law.
    keep : bool
        Whether they may be asked for again; those kept last are given again.

    Returns
    -------
    Standing or None
        None where images do not share layers.
    """
    if not case.shares_still_layers:
        return None
    return (_kept if keep else _ready)(
        tuple(layers),
        case.microscope,
        case.window,
        reach,
        model,
        case.sampling,
        case.lamp_aperture,
        _heights_um(case) if layers else (),
    )


def fresh(case: LookCase, layers: Sequence[Layer]) -> Backdrop:
    """Return layers of a look as it is, transformed for one image alone."""
    if not case.shares_still_layers:
        return Backdrop()
    found = cover_few(
        layers,
        case.microscope,
        focus_um=case.focus_um,
        model=case.model,
        window=case.window,
        sampling=case.sampling,
    )
    under = None
    if case.lamp_aperture is not None and layers:
        under = irradiances(
            layers,
            _heights_um(case),
            case.microscope,
            lamp_aperture=case.lamp_aperture,
            focus_um=(case.focus_um,),
            window=case.window,
            few_points=case.sampling.few_points,
        )
    return Backdrop(found, under)


def _heights_um(case: LookCase) -> tuple[float, ...]:
    """Return the heights that may be shaded, rising."""
    found = {layer.z_um for layer in (*case.static, *case.moving)}
    if case.background_z_um is not None:
        found.add(case.background_z_um)
    return tuple(sorted(found))


def _ready(
    layers: tuple[Layer, ...],
    microscope: Microscope,
    window: Window,
    reach: Range,
    model: str,
    sampling: Sampling,
    lamp_aperture: float | None,
    heights_um: tuple[float, ...],
) -> Standing:
    """Return layers ready for images, and the light that they leave at heights."""
    found = None
    if lamp_aperture is not None and heights_um:
        found = irradiances(
            layers,
            heights_um,
            microscope,
            lamp_aperture=lamp_aperture,
            focus_um=reach.focus_um,
            window=reach.frame(microscope, window),
        )
    ready = prepare(
        Scene(layers=layers, background=0.0),
        microscope,
        reach,
        model=model,
        window=window,
        sampling=sampling,
    )
    return Standing(prepared=ready, lights=found)


_kept = lru_cache(maxsize=_HELD)(_ready)


def displaced(layer: Layer, by_um: tuple[float, float]) -> Layer:
    """Return a layer elsewhere, um."""
    if by_um == (0.0, 0.0):
        return layer
    return replace(layer, outline=place(layer.outline, *by_um, 0.0))
