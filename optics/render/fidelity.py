"""The cheapest model of an image within an error budget.

The error is predicted on the scene itself: its cheap image is compared
with one of the exact model, a wider band and a wider margin, and bounds of what the
second image still lacks are added.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.outline.tolerant_order import at_most
from microplan.optics.render.render import render
from microplan.optics.render.sampling import FAR_ERROR, SINGLE_ERROR, Sampling
from microplan.optics.render.scene import Layer, Scene, Window
from microplan.optics.render.tile_aliasing import MARGINS, margin_for, wrap_error
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import TABLE_ERROR, find_model

LADDER = ("stokseth", "hopkins", "exact")  # OTF models, the cheapest table first
# Shares of the limit that band, margin and single precision may take; the model has
# what they leave.
_BAND_SHARE = 0.25
_WRAP_SHARE = 0.25
_SINGLE_SHARE = 1e-3
_BANDS = (1e-5, 5e-3)  # below them tables err more, above them nothing is gained
# The image compared with: a band whose cut costs next to nothing, even in the middle of
# circles, where it adds up to twice the prediction; and a wider margin. All of the band
# would take gigabytes where blurs are wide.
_FINE = 1e-5  # band error
_WIDER = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """A cheaper model that was tried and not taken."""

    model: str
    predicted_error: float  # of unit contrast


@dataclass(frozen=True, slots=True, kw_only=True)
class Fidelity:
    """How an image is computed, and the largest error that makes, of unit contrast."""

    model: str  # a key of `microplan.optics.transfer.models.MODELS`
    sampling: Sampling
    predicted_error: float  # model, band, margin and tables together
    sampling_error: float  # the part of it that stays with the exact model
    limit: float
    refused: tuple[Refusal, ...]

    @property
    def keeps_limit(self) -> bool:
        """Return whether the predicted error is within the limit."""
        return at_most(self.predicted_error, self.limit)


def choose(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: Sequence[float],
    limit: float,
    window: Window | None = None,
    ladder: Sequence[str] = LADDER,
) -> Fidelity:
    """Return the cheapest model, band and margin whose predicted error fits.

    Parameters
    ----------
    focus_um : sequence of float
        World heights in focus that the choice must hold for, at least one.
    limit : float
        Admissible image error, of unit contrast.
    window : Window, optional
        The part of the frame that matters; default all.
    ladder : sequence of str
        Models to choose from, the cheapest first. If none fits, the last is taken.

    Returns
    -------
    Fidelity
        The prediction is of model and sampling; what blending layers costs comes on
        top, see `microplan.optics.ledger`.

    Raises
    ------
    ValueError
        If a model is unknown, `limit` is not positive and finite, or no focus is given.
    """
    if not (limit > 0 and math.isfinite(limit)):
        raise ValueError(f"limit must be positive and finite, got {limit}")
    if not ladder or not focus_um:
        raise ValueError("at least one law and one focus are needed")
    for model in ladder:
        find_model(model)
    pilot = Pilot(
        scene=scene,
        microscope=microscope,
        window=window,
        focus_um=tuple(focus_um),
    )
    sampling = pilot.sampling(limit)
    refused: list[Refusal] = []
    for model in ladder:
        error = rounded_up(max(pilot.error(model, sampling, z) for z in focus_um))
        if at_most(error, limit) or model == ladder[-1]:
            break
        refused.append(Refusal(model=model, predicted_error=error))
    kept = max(pilot.error("exact", sampling, z) for z in focus_um)
    return Fidelity(
        model=model,
        sampling=sampling,
        predicted_error=error,
        sampling_error=min(rounded_up(kept), error),
        limit=limit,
        refused=tuple(refused),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Pilot:
    """Images of one scene, to compare methods of computing them."""

    scene: Scene
    microscope: Microscope
    window: Window | None = None
    focus_um: tuple[float, ...] = ()  # for which the bounds have to hold
    _images: dict[tuple[str, Sampling, float], FloatArray] = field(
        default_factory=dict, repr=False, compare=False
    )

    def sampling(self, limit: float) -> Sampling:
        """Return the least band, margin and precision that keep shares of `limit`."""
        return Sampling(
            band_error=min(max(_BAND_SHARE * limit, _BANDS[0]), _BANDS[1]),
            margin=self._margin(_WRAP_SHARE * limit),
            single=_SINGLE_SHARE * limit >= SINGLE_ERROR,
        )

    def error(self, model: str, sampling: Sampling, focus_um: float) -> float:
        """Return the predicted error of one method of computing, of unit contrast."""
        finer = Sampling(band_error=_FINE, margin=sampling.margin * _WIDER)
        found = self._image(model, sampling, focus_um)
        better = self._image("exact", finer, focus_um)
        return float(np.abs(found - better).max()) + self.rest(finer.margin)

    def rest(self, margin: float) -> float:
        """Return a bound of what the exact model with a fine band still lacks."""
        rest = 0.0
        for layer, step in zip(self.scene.layers, steps(self.scene), strict=True):
            wrap = wrap_error(
                layer.outline,
                self.microscope,
                margin,
                self.window,
                blur_um=self._blur_um(layer),
            )
            rest += step * (wrap + TABLE_ERROR + FAR_ERROR + 2 * _FINE)
        return rest

    def _margin(self, share: float) -> float:
        """Return the margin with which all layers together wrap `share` at most."""
        least = 0.0
        for layer, step in zip(self.scene.layers, steps(self.scene), strict=True):
            if step > 0:
                allowed = share / (step * len(self.scene.layers))
                margin = margin_for(
                    layer.outline,
                    self.microscope,
                    allowed,
                    self.window,
                    blur_um=self._blur_um(layer),
                )
                least = max(least, margin)
        return least or float(MARGINS[0])

    def _blur_um(self, layer: Layer) -> float:
        """Return the largest radius of a layer's blur circle."""
        depths = (layer.z_um - focus_um for focus_um in self.focus_um)
        return max((self.microscope.blur_diameter_um(z) for z in depths), default=0) / 2

    def _image(self, model: str, sampling: Sampling, focus_um: float) -> FloatArray:
        key = (model, sampling, focus_um)
        if key not in self._images:
            self._images[key] = render(
                self.scene,
                self.microscope,
                focus_um=focus_um,
                model=model,
                window=self.window,
                sampling=sampling,
            )
        return self._images[key]


def steps(scene: Scene) -> tuple[float, ...]:
    """Return for each layer the largest step of reflectance that its edges can make."""
    found = []
    for layer in scene.layers:
        behind = [scene.background]
        behind += [o.reflectance for o in scene.layers if o.z_um <= layer.z_um]
        found.append(max(abs(layer.reflectance - other) for other in behind))
    return tuple(found)


def rounded_up(error: float, finest: float = 0.0) -> float:
    """Return `error` with two digits, in units of `finest` at least, never less.

    Machines differ in the last bits of an image; what is decided by a prediction, and
    what a plan says of it, should not.
    """
    if error <= 0:
        return 0.0
    unit = max(10.0 ** (math.floor(math.log10(error)) - 1), finest)
    return math.ceil(error / unit * (1 - 1e-9)) * unit
