"""Reference images by plain sums over waves, the judge of faster ones.

The transfer is 0 beyond the cutoff, so the image on a periodic tile is a finite sum of
waves. Here every coefficient comes from the outline's Fourier transform in closed form
(arcs by Gauss panels), and every pixel is a plain sum over all waves: no gridding, no
cut of the band, no fast transform, no coarse table.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.interpolate import CubicSpline

from microplan.arrays import Box, FloatArray
from microplan.optics.layers.occlusion import Tracing, cell_um
from microplan.optics.layers.rays import slopes
from microplan.optics.outline.clip import EdgeArrays, clip, common, grown, to_edges
from microplan.optics.outline.fourier_integral import transform
from microplan.optics.outline.outline import Outline
from microplan.optics.render.pixels import axis_px
from microplan.optics.render.render import Covered
from microplan.optics.render.scene import Scene, Window
from microplan.optics.render.spectrum import Tile, band_orders
from microplan.optics.render.view_range import full
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import curve_of

# Where a body reaches far beyond the window it is cut at this distance, in wavelengths
# over A: an endless edge cut there costs (wavelength / A) / (pi**3 d) = 1.5e-4.
CUT = 210.0
_TABLE_RAD = 0.01  # of phase between knots: cubics err by (0.01)**4 / 384, 3e-11
_BLOCK = 1 << 20  # waves held at once, 16 MB an array


@dataclass(frozen=True, slots=True, kw_only=True)
class Oracle:
    """One outline over black, ready for exact images of one window."""

    microscope: Microscope
    window: Window
    edges: EdgeArrays
    tile: Tile
    deepest_um: float  # the largest defocus that keeps `wrap_error`
    wrap_error: float  # what repetition and cutting cost at most [1]

    @classmethod
    def of(
        cls,
        outline: Outline,
        microscope: Microscope,
        *,
        window: Window | None = None,
        deepest_um: float = 50.0,
        wrap_error: float = 2e-5,
    ) -> Self:
        """Return the oracle of a part.

        Parameters
        ----------
        outline : Outline
            The body in the world frame, um; at least one ring.
        microscope : Microscope
            The optical setting; the camera's axis is the world's origin.
        window : Window, optional
            The pixels wanted. Default: all.
        deepest_um : float
            The largest defocus asked for, of either sign.
        wrap_error : float
            What the tile's repetitions may add, of unit contrast; the tile is
            large enough for that. A body that is cut costs more, see the field.

        Returns
        -------
        Oracle
            The time of an image grows with the tile's area and the edges' length;
            memory with the window and one side of the tile only.

        Notes
        -----
        At a distance r beyond its blur circle a point's image is, averaged over its
        rings, (wavelength / A) / (2 pi**3 r**3), at most twice that. Repetitions in
        rings of 8 k at k times the least distance d sum up to 8 zeta(2) / d**3.
        """
        frame = window or full(microscope)
        airy = microscope.wavelength_um / microscope.aperture
        blur = microscope.blur_diameter_um(deepest_um) / 2
        reach = blur + CUT * airy
        box = grown(_box(microscope, frame), reach)
        edges, bounds, cut = to_edges(outline), outline.bounds_um, 0.0
        if not _holds(box, bounds):
            edges, bounds = clip(outline, box), common(box, bounds)
            cut = 4 / (np.pi**3 * CUT)  # four sides
        each = abs(edges.area_um2) * airy / np.pi**3 * 8 * np.pi**2 / 6
        apart = blur + max((each / wrap_error) ** (1 / 3), 20 * airy)
        tile = _tile(_box(microscope, frame), bounds, apart)
        return cls(
            microscope=microscope,
            window=frame,
            edges=edges,
            tile=tile,
            deepest_um=deepest_um,
            wrap_error=wrap_error + cut,
        )

    def image(self, model: str, z_um: float) -> FloatArray:
        """Return the image of a white body over black, (rows, columns), 0..1.

        See `images`, which shares the work of several.
        """
        found: FloatArray = self.images([(model, z_um)])[0]
        return found

    def images(self, models: Sequence[tuple[str, float]]) -> FloatArray:
        """Return images by model and defocus.

        Parameters
        ----------
        models : sequence of (model, z_um)
            A key of `microplan.optics.transfer.models.MODELS` each, and the height of
            the body minus that of the plane in focus, um. Every model ends at the
            cutoff.

        Returns
        -------
        (N, rows, columns) float64 array
            Coverage of the pixels, within `wrap_error` and some 1e-9 of the model's.

        Raises
        ------
        ValueError
            If a model is unknown or a defocus beyond `deepest_um`.
        """
        for _, z_um in models:
            if not abs(z_um) <= self.deepest_um:
                raise ValueError(
                    f"defocus must be within {self.deepest_um} um, got {z_um}"
                )
        m, tile = self.microscope, self.tile
        tables = [tabulated(model, m, z_um) for model, z_um in models]
        J, K = band_orders(tile, m.cutoff_per_um)
        u = np.arange(J + 1) / tile.width_um
        side = m.um_per_px * math.sqrt(m.fill_factor)
        x, y = _centers(m, self.window)
        right = np.exp(2j * np.pi * u[:, None] * x)
        right[1:] *= 2  # the other half of the waves is the conjugate
        right *= (np.sinc(u * side) / (tile.width_um * tile.height_um))[:, None]
        total = np.zeros((len(models), y.size, x.size))
        step = max(1, _BLOCK // (J + 1))
        for start in range(-K, K + 1, step):
            v = np.arange(start, min(start + step, K + 1)) / tile.height_um
            waves = transform(self.edges, u, v)
            up = np.exp(2j * np.pi * y[:, None] * v) * np.sinc(v * side)
            share = np.hypot(u, v[:, None]) / m.cutoff_per_um
            for i, table in enumerate(tables):
                total[i] += ((up @ (waves * table(share))) @ right).real
        return total


def oracle_image(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: float,
    model: str = "exact",
    window: Window | None = None,
    samples: int = 4096,
    step_um: float | None = None,
) -> FloatArray:
    """Return the reference image of several layers, all of it traced.

    Parameters
    ----------
    scene, microscope, focus_um, model, window
        As in `microplan.optics.layers.occlusion.occluded`, whose formula this is.
    samples : int
        Rays through each cell.
    step_um : float, optional
        Largest side of a cell. Default: half of what `occluded` takes.

    Returns
    -------
    (rows, columns) float64 array
        Share of full scale. Layers blurred by the model come from `Oracle`. What rays
        and cells cost: `benchmarks.optics.layers`; what rays lack:
        `microplan.optics.layers.layer_error`.
    """
    frame = window or full(microscope)

    def blurred(fine: Microscope, cut: Window) -> list[Covered]:
        found = []
        for layer in scene.layers:
            z_um = layer.z_um - focus_um
            one = Oracle.of(layer.outline, fine, window=cut, deepest_um=abs(z_um))
            found.append(Covered(layer=layer, coverage=one.image(model, z_um)))
        return found

    tracing = Tracing(
        scene=scene,
        microscope=microscope,
        focus_um=focus_um,
        model=model,
        tangents=slopes(microscope, samples),
        step_um=step_um or cell_um(scene.layers, microscope) / 2,
    )
    return tracing.image(frame, blurred)


Table = Callable[[FloatArray], FloatArray]  # share of the cutoff (...) -> transfer


def tabulated(model: str, microscope: Microscope, z_um: float) -> Table:
    """Return a model's OTF as a fine table: 0 from the cutoff on, else within 1e-9.

    Knots lie evenly in sqrt(1 - x), where every model is smooth to the end.
    """
    waves = abs(microscope.rim_w20_um(z_um)) / microscope.wavelength_um
    count = 2000 + math.ceil(16 * np.pi * waves / _TABLE_RAD)
    knots = np.linspace(0, 1, count)
    curve = curve_of(model, microscope, z_um)
    spline = CubicSpline(knots, curve(1 - knots**2))

    def read(x: FloatArray) -> FloatArray:
        value: FloatArray = spline(np.sqrt(1 - np.minimum(x, 1.0)))
        return np.where(x < 1, value, 0.0)

    return read


def _centers(microscope: Microscope, window: Window) -> tuple[FloatArray, FloatArray]:
    """Return x (columns,) and y (rows,) of the pixels' centres, um."""
    cx, cy = axis_px(microscope)
    p = microscope.um_per_px
    columns = np.arange(window.columns, dtype=np.float64)
    rows = np.arange(window.rows, dtype=np.float64)
    return (columns + window.column - cx) * p, (cy - window.row - rows) * p


def _box(microscope: Microscope, window: Window) -> Box:
    """Return the box around the pixels' centres, um."""
    x, y = _centers(microscope, window)
    return (float(x[0]), float(y[-1]), float(x[-1]), float(y[0]))


def _holds(box: Box, bounds: Box) -> bool:
    return common(box, bounds) == bounds


def _tile(seen: Box, body: Box, apart_um: float) -> Tile:
    """Return a tile that keeps repetitions of `body` away from what is seen."""
    width, height = (
        max(body[i + 2] - seen[i], seen[i + 2] - body[i], body[i + 2] - body[i])
        for i in (0, 1)
    )
    return Tile(
        left_um=min(seen[0], body[0]),
        bottom_um=min(seen[1], body[1]),
        width_um=max(width, 0.0) + apart_um,
        height_um=max(height, 0.0) + apart_um,
    )
