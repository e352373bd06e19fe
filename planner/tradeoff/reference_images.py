"""Reference images of a look: exact defocus model, layers traced ray by ray."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.layers.occlusion import Tracing, cell_um, meeting
from microplan.optics.layers.rays import LayerSheet, sheets, slopes
from microplan.optics.oracle import Oracle
from microplan.optics.render.fidelity import Pilot
from microplan.optics.render.render import Covered, cover, render_stack
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Scene, Window
from microplan.optics.render.spectrum import band_orders
from microplan.optics.transfer.microscope import Microscope

_WHOLE = 1e-12  # band error that leaves nothing out
_WIDER = 2.0  # the margin over the widest that is measured
# Waves times edges that the closed form may take; a billion take about a minute.
_SLOWEST = 2.5e8
_TRACED = 4096  # rays a cell; a quarter of them shows what they err
_TRACED_BAND = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceView:
    """Scene of a look, with the focus heights at which images of it must be right."""

    scene: Scene
    microscope: Microscope
    window: Window
    focus_um: tuple[float, ...]  # the nominal one first

    @property
    def is_layered(self) -> bool:
        """Return whether layers of different height are in view."""
        return len({layer.z_um for layer in self.scene.layers}) > 1


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceImages:
    """Reference images of a look."""

    images: FloatArray  # (focus heights, rows, columns), share of full scale
    name: str  # what they are
    error: float  # how far they may be off, of unit contrast


def law_truth(sight: ReferenceView, margin: float) -> ReferenceImages:
    """Return images by the exact model at all focus heights, layers blended.

    Parameters
    ----------
    sight : Sight
        What is rendered.
    margin : float
        The widest that is measured, in wavelengths / A.

    Returns
    -------
    Truth
        Of one layer, and if that does not take minutes, by the closed form of
        `microplan.optics.oracle`; else by all of the band and twice the margin.
    """
    if len(sight.scene.layers) == 1:
        (layer,) = sight.scene.layers
        depths = [layer.z_um - z for z in sight.focus_um]
        oracle = Oracle.of(
            layer.outline,
            sight.microscope,
            window=sight.window,
            deepest_um=max(map(abs, depths)),
        )
        if _work(oracle) <= _SLOWEST:
            step = layer.reflectance - sight.scene.background
            covers = oracle.images([("exact", depth) for depth in depths])
            return ReferenceImages(
                images=sight.scene.background + step * covers,
                name="closed form, every wave of the band",
                error=abs(step) * oracle.wrap_error,
            )
    far = _WIDER * margin
    wide = Sampling(band_error=_WHOLE, margin=far, near=far)  # nothing is made up for
    images = render_stack(
        sight.scene,
        sight.microscope,
        focus_um=sight.focus_um,
        window=sight.window,
        sampling=wide,
    )
    pilot = Pilot(
        scene=sight.scene,
        microscope=sight.microscope,
        window=sight.window,
        focus_um=sight.focus_um,
    )
    return ReferenceImages(
        images=images,
        name="the exact law with all of the band and twice the margin",
        error=pilot.rest(wide.margin),
    )


def layer_truth(
    sight: ReferenceView, law: ReferenceImages, margin: float
) -> ReferenceImages:
    """Return the image at the nominal focus with layers that hide one another.

    As `microplan.optics.layers.occlusion.occluded`, with more rays, and a wide band and
    `margin`: what lies between blurred edges of different height is traced, the rest is
    as blended.
    """
    part = meeting(_sheets(sight, margin))
    if part is None:
        return ReferenceImages(images=law.images[:1], name=law.name, error=law.error)
    side = cell_um(sight.scene.layers, sight.microscope)
    crop = _piece(sight.window, part)
    fine = _traced(sight, crop, margin, rays=_TRACED, step_um=side)
    coarse = _traced(sight, crop, margin, rays=_TRACED // 4, step_um=2 * side)
    images = law.images[:1].copy()
    images[0][part] = fine
    return ReferenceImages(
        images=images,
        name=f"layers traced by {_TRACED} rays a cell",
        error=max(float(np.abs(fine - coarse).max()), law.error),
    )


def _sheets(sight: ReferenceView, margin: float) -> list[LayerSheet]:
    """Return what covers the pixels at each height, in the nominal focus."""
    covered = _covered(sight, sight.microscope, sight.window, margin)
    return sheets([c.layer for c in covered], [c.coverage for c in covered])


def _covered(
    sight: ReferenceView, setting: Microscope, cut: Window, margin: float
) -> tuple[Covered, ...]:
    """Return the layers blurred by the exact model in the nominal focus."""
    return cover(
        sight.scene.layers,
        setting,
        focus_um=sight.focus_um[0],
        window=cut,
        sampling=Sampling(band_error=_TRACED_BAND, margin=margin),
    )


def _piece(frame: Window, part: tuple[slice, slice]) -> Window:
    """Return rows and columns of a window as a window."""
    return Window(
        row=frame.row + part[0].start,
        column=frame.column + part[1].start,
        rows=part[0].stop - part[0].start,
        columns=part[1].stop - part[1].start,
    )


def _traced(
    sight: ReferenceView, crop: Window, margin: float, *, rays: int, step_um: float
) -> FloatArray:
    """Return the image of a crop with every ray traced."""

    tracing = Tracing(
        scene=sight.scene,
        microscope=sight.microscope,
        focus_um=sight.focus_um[0],
        model="exact",
        tangents=slopes(sight.microscope, rays),
        step_um=step_um,
    )
    return tracing.image(
        crop, lambda setting, cut: _covered(sight, setting, cut, margin)
    )


def _work(oracle: Oracle) -> float:
    """Return the waves times the edges of an oracle's image."""
    J, K = band_orders(oracle.tile, oracle.microscope.cutoff_per_um)
    edges = len(oracle.edges.segments) + len(oracle.edges.arcs)
    return float(edges * (J + 1) * (2 * K + 1))
