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


def exact_reference(seen: ReferenceView, margin: float) -> ReferenceImages:
    """Return images by the exact model at all focus heights, layers blended.

    Parameters
    ----------
    seen : ReferenceView
        What is rendered.
    margin : float
        The widest that is measured, in wavelengths / A.

    Returns
    -------
    ReferenceImages
        Of one layer, and if that does not take minutes, by the closed form of
        `microplan.optics.oracle`; else by all of the band and twice the margin.
    """
    lens = seen.microscope
    if len(seen.scene.layers) == 1 and not lens.wavefront and lens.halo is None:
        (layer,) = seen.scene.layers
        depths = [layer.z_um - z for z in seen.focus_um]
        oracle = Oracle.of(
            layer.outline,
            seen.microscope,
            window=seen.window,
            deepest_um=max(map(abs, depths)),
        )
        if _work(oracle) <= _SLOWEST:
            step = layer.reflectance - seen.scene.background
            covers = oracle.images([("exact", depth) for depth in depths])
            return ReferenceImages(
                images=seen.scene.background + step * covers,
                name="closed form, every wave of the band",
                error=abs(step) * oracle.wrap_error,
            )
    far = _WIDER * margin
    wide = Sampling(band_error=_WHOLE, margin=far, near=far)  # nothing is made up for
    images = render_stack(
        seen.scene,
        seen.microscope,
        focus_um=seen.focus_um,
        window=seen.window,
        sampling=wide,
    )
    pilot = Pilot(
        scene=seen.scene,
        microscope=seen.microscope,
        window=seen.window,
        focus_um=seen.focus_um,
    )
    return ReferenceImages(
        images=images,
        name="the exact law with all of the band and twice the margin",
        error=pilot.rest(wide.margin),
    )


def traced_reference(
    seen: ReferenceView, law: ReferenceImages, margin: float
) -> ReferenceImages:
    """Return the image at the nominal focus with layers that hide one another.

    As `microplan.optics.layers.occlusion.occluded`, with more rays, and a wide band and
    `margin`: what lies between blurred edges of different height is traced, the rest is
    as blended.
    """
    part = meeting(_sheets(seen, margin))
    if part is None:
        return ReferenceImages(images=law.images[:1], name=law.name, error=law.error)
    side = cell_um(seen.scene.layers, seen.microscope)
    crop = _piece(seen.window, part)
    fine = _traced(seen, crop, margin, rays=_TRACED, step_um=side)
    coarse = _traced(seen, crop, margin, rays=_TRACED // 4, step_um=2 * side)
    images = law.images[:1].copy()
    images[0][part] = fine
    return ReferenceImages(
        images=images,
        name=f"layers traced by {_TRACED} rays a cell",
        error=max(float(np.abs(fine - coarse).max()), law.error),
    )


def _sheets(seen: ReferenceView, margin: float) -> list[LayerSheet]:
    """Return what covers the pixels at each height, in the nominal focus."""
    covered = _covered(seen, seen.microscope, seen.window, margin)
    return sheets([c.layer for c in covered], [c.coverage for c in covered])


def _covered(
    seen: ReferenceView, setting: Microscope, cut: Window, margin: float
) -> tuple[Covered, ...]:
    """Return the layers blurred by the exact model in the nominal focus."""
    return cover(
        seen.scene.layers,
        setting,
        focus_um=seen.focus_um[0],
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
    seen: ReferenceView, crop: Window, margin: float, *, rays: int, step_um: float
) -> FloatArray:
    """Return the image of a crop with every ray traced."""

    tracing = Tracing(
        scene=seen.scene,
        microscope=seen.microscope,
        focus_um=seen.focus_um[0],
        model="exact",
        tangents=slopes(seen.microscope, rays),
        step_um=step_um,
    )
    return tracing.image(
        crop, lambda setting, cut: _covered(seen, setting, cut, margin)
    )


def _work(oracle: Oracle) -> float:
    """Return the waves times the edges of an oracle's image."""
    J, K = band_orders(oracle.tile, oracle.microscope.cutoff_per_um)
    edges = len(oracle.edges.segments) + len(oracle.edges.arcs)
    return float(edges * (J + 1) * (2 * K + 1))
