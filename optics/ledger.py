"""Ledger of optical effects with the error that each model leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from microplan.optics.coherence.degree import Coherence
from microplan.optics.coherence.edge_offsets import (
    EDGE_WAVES,
    amplitude_contrast,
    edge_offset_um,
    scene_error,
)
from microplan.optics.coherence.unmodelled import (
    FLAT_BAND,
    spectrum_error,
    vectorial_error,
)
from microplan.optics.layers.layer_error import LayerChoice
from microplan.optics.layers.shading import SHADED_ERROR
from microplan.optics.layers.solids.solid_bodies import is_solid
from microplan.optics.layers.wall_error import most_shade_error, wall_error
from microplan.optics.lens.lens_budget import LensRow
from microplan.optics.render.fidelity import Fidelity, rounded_up, steps
from microplan.optics.render.scene import Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope

# rms error of images in light from below and from a ring against single rays through
# sharp prisms (`tests/optics/light`)
LIT_ERROR = 0.012
CONTRAST, NM = "unit contrast", "nm"
_NM_PER_UM = 1000.0
_LEVELS = {
    "blend": "coverage, back to front",
    "joint": "coverage, what bodies hide and shade together by rays",
    "occluded": "hidden and shaded ray by ray",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class LedgerRow:
    """One effect, how it is treated, and what leaving the rest out costs.

    `predicted_error` and `limit` are in the unit that `unit` names; None where it is
    not predicted, and then `level` says `not modelled`.
    """

    effect: str
    level: str
    predicted_error: float | None
    limit: float | None
    unit: str  # CONTRAST or NM
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Imaged:
    """An image as it is computed: of what, through what, and at which fidelity."""

    scene: Scene
    microscope: Microscope
    focus_um: float
    fidelity: Fidelity
    layering: LayerChoice
    window: Window | None = None  # the part of the frame that matters; None: all
    coherence: Coherence | None = None  # condenser over objective; None: incoherent
    lamp_aperture: float | None = None  # of light through the objective; None: other
    is_shaded: bool = False  # whether that light is shaded by higher bodies
    light: str = ""  # another light whose shade is in the image: its kind


def ledger(
    imaged: Imaged, lens: Sequence[LensRow] = (), shift_limit_nm: float | None = None
) -> tuple[LedgerRow, ...]:
    """Return what an image models, and what the rest may cost.

    Parameters
    ----------
    imaged : Imaged
        The image.
    lens : sequence of LensRow
        What the lens does to the target, see
        `microplan.optics.lens.lens_budget.predict`.
    shift_limit_nm : float, optional
        How far the target may seem to move.

    Returns
    -------
    tuple of LedgerRow
        Always the same effects in the same order. Predictions are of single effects;
        they do not add up to a bound of the image.
    """
    return (
        _model_row(imaged.fidelity),
        _layer_row(imaged.layering),
        _shade_row(imaged),
        *_sampling_rows(imaged.fidelity),
        *_light_rows(imaged, shift_limit_nm),
        *(_lens_row(row, shift_limit_nm) for row in lens),
        _wall_row(imaged),
    )


def _model_row(fidelity: Fidelity) -> LedgerRow:
    """Return the row of the OTF model, with the cheaper models that were refused."""
    refused = ", ".join(
        f"{r.model} errs by {r.predicted_error:.2g}" for r in fidelity.refused
    )
    return _row(
        "defocus law",
        fidelity.model,
        fidelity.predicted_error,
        fidelity.limit,
        f"measured on this scene; {refused or 'the cheapest law will do'}",
    )


def _layer_row(layering: LayerChoice) -> LedgerRow:
    """Return the row of layers over one another, with the treatment not taken."""
    refused = ", ".join(
        f"{r.treatment} errs by {r.predicted_error:.2g}" for r in layering.refused
    )
    return _row(
        "layers of different height",
        _LEVELS[layering.treatment],
        layering.predicted_error,
        layering.limit,
        f"measured where edges meet; {refused or 'the cheapest treatment will do'}",
    )


def _shade_row(imaged: Imaged) -> LedgerRow:
    """Return the row of light that higher bodies keep from what is below."""
    effect, limit = "shade of higher bodies", imaged.fidelity.limit
    if imaged.light:
        reason = f"light of kind {imaged.light}, past bodies with their walls"
        return _row(effect, "modelled", LIT_ERROR, limit, reason)
    if imaged.lamp_aperture is None:
        reason = "the light does not come through the objective; nobody predicts it"
        return _row(effect, "not modelled", None, limit, reason)
    error = most_shade_error(
        imaged.scene,
        imaged.microscope,
        focus_um=imaged.focus_um,
        lamp_aperture=imaged.lamp_aperture,
        window=imaged.window,
    )
    if not imaged.is_shaded:
        return _row(effect, "left out", error, limit, "measured on this scene")
    reason = f"coaxial light; leaving it out would err by {error:.2g}"
    return _row(effect, "modelled", min(SHADED_ERROR, error), limit, reason)


def _wall_row(imaged: Imaged) -> LedgerRow:
    """Return the row of the sides of bodies."""
    effect, limit = "side walls", imaged.fidelity.limit
    if not is_solid(imaged.scene.layers):
        reason = "bodies are flat faces; nobody predicts what their sides send back"
        return _row(effect, "not modelled", None, limit, reason)
    reason = "walls stand upright and mirror as stated; nobody predicts rough ones"
    if imaged.lamp_aperture is None or not imaged.is_shaded:
        return _row(effect, "not modelled", None, limit, reason)
    error = wall_error(
        imaged.scene,
        imaged.microscope,
        focus_um=imaged.focus_um,
        lamp_aperture=imaged.lamp_aperture,
        window=imaged.window,
    )
    return _row(effect, "modelled", error, limit, reason)


def _sampling_rows(fidelity: Fidelity) -> tuple[LedgerRow, ...]:
    limit, sampling = fidelity.limit, fidelity.sampling
    return (
        _row("pixel integration", "area of a pixel", 0.0, limit, "exact in the band"),
        _row(
            "band and tile",
            f"cut at {sampling.band_error:.2g}, margin {sampling.margin:.3g} lambda/A",
            fidelity.sampling_error,
            limit,
            "with the exact law, measured on this scene",
        ),
    )


def _light_rows(imaged: Imaged, shift_limit_nm: float | None) -> tuple[LedgerRow, ...]:
    """Return the effects of the light that images leave out."""
    limit, optics = imaged.fidelity.limit, imaged.microscope
    step = max(steps(imaged.scene), default=0.0)
    defocus_um = max(
        (abs(layer.z_um - imaged.focus_um) for layer in imaged.scene.layers),
        default=0.0,
    )
    spectrum = max(spectrum_error(optics, z) for z in (0.0, defocus_um))
    return (
        *_coherence_rows(imaged, shift_limit_nm),
        _row(
            "vectorial field",
            "not modelled",
            rounded_up(step * vectorial_error(optics)),
            limit,
            "largest step of the scene, at an edge in focus",
        ),
        _row(
            "spectrum of the light",
            "not modelled",
            rounded_up(step * spectrum),
            limit,
            f"a flat band of {FLAT_BAND:.0%}, at an edge in focus and far from it",
        ),
    )


def _coherence_rows(
    imaged: Imaged, shift_limit_nm: float | None
) -> tuple[LedgerRow, ...]:
    """Return what partly coherent light does to the image and to its edges."""
    limit, coherence = imaged.fidelity.limit, imaged.coherence
    error, offset_um, level = 0.0, 0.0, "off"
    reason = "the workcell states incoherent light"
    near = _near_focus(imaged)
    if coherence is not None:
        level, reason = "charged", f"coherence {coherence}, layers near focus"
        if not coherence.is_stated:
            reason = f"coherence not stated: {reason}"
        scene = replace(imaged.scene, layers=near)
        error = max(
            scene_error(scene, imaged.microscope, focus_um=imaged.focus_um, coherence=s)
            for s in coherence.samples
        )
        offset_um = max(
            (_offset_um(imaged, layer, coherence.worst) for layer in near), default=0.0
        )
    return (
        _row("partial coherence", level, rounded_up(error), limit, reason),
        LedgerRow(
            effect="edge offset by coherence",
            level=level,
            predicted_error=rounded_up(offset_um * _NM_PER_UM),
            limit=shift_limit_nm,
            unit=NM,
            reason=f"{reason}; of each edge, centres of symmetry stay",
        ),
    )


def _near_focus(imaged: Imaged) -> tuple[Layer, ...]:
    """Return the layers whose edges partial coherence is predicted for."""
    optics = imaged.microscope
    return tuple(
        layer
        for layer in imaged.scene.layers
        if abs(optics.rim_w20_um(layer.z_um - imaged.focus_um))
        <= EDGE_WAVES * optics.wavelength_um
    )


def _offset_um(imaged: Imaged, layer: Layer, coherence: float) -> float:
    """Return how far edges of a layer move against whatever they border on."""
    others = [imaged.scene.background]
    others += [o.reflectance for o in imaged.scene.layers if o.z_um <= layer.z_um]
    return max(
        edge_offset_um(
            coherence,
            imaged.microscope,
            amplitude_contrast(layer.reflectance, other),
            layer.z_um - imaged.focus_um,
        )
        if max(layer.reflectance, other) > 0
        else 0.0
        for other in others
    )


def _lens_row(row: LensRow, shift_limit_nm: float | None) -> LedgerRow:
    """Return a lens' row: what is left of it and one sigma of what is not known."""
    return LedgerRow(
        effect=row.effect,
        level=row.level,
        predicted_error=rounded_up(row.left_nm + row.sigma_nm),
        limit=shift_limit_nm if row.axis == "xy" else None,
        unit=NM,
        reason=f"known {row.known_nm:.3g} nm, of it left {row.left_nm:.3g}, sigma "
        f"{row.sigma_nm:.3g}; {row.reason}",
    )


def _row(
    effect: str, level: str, error: float | None, limit: float, reason: str
) -> LedgerRow:
    return LedgerRow(
        effect=effect,
        level=level,
        predicted_error=error,
        limit=limit,
        unit=CONTRAST,
        reason=reason,
    )
