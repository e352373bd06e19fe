"""Ray-traced occlusion between layers, where blending blurred layers is not enough.

Blending takes the mean over the pupil of a product of two layers for the product of
their means. Here the difference is traced along rays and put in where blurred edges of
layers of different height meet.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy import fft

from microplan.arrays import FloatArray
from microplan.optics.layers.mirrors.narrow_lamp import LitPart, lit_parts
from microplan.optics.layers.mirrors.sheets import polished, with_mirrors
from microplan.optics.layers.rays import (
    Fan,
    Grid,
    LayerSheet,
    composite,
    extent,
    hard,
    reach_cells,
    sheets,
    slopes,
    trace,
)
from microplan.optics.layers.shade import light_share
from microplan.optics.render.pixels import axis_px
from microplan.optics.render.render import Covered, cover, render
from microplan.optics.render.scene import Illumination, Layer, Scene, Window
from microplan.optics.render.view_range import full
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import tabulate
from microplan.optics.transfer.otf import diffraction

# the layers blurred by the model at the pixels of a finer microscope
Blurred = Callable[[Microscope, Window], Sequence[Covered]]

SAMPLES = 256  # rays a cell
# Coverage this close to 0 or 1 counts as uniform: what two layers hide of each other
# differs from the product by at most the smaller of the two.
_UNIFORM = 0.005
_TAIL = 12.0  # wavelengths over A around the crop, for the in-focus filter
# Cells are this share of wavelength / A at least, or of how far rays part between
# neighbouring layers; products of coverages are wrong in cells that two edges share.
_FINE, _COARSE, _PARTING = 0.12, 0.5, 1 / 40


def occluded(
    scene: Scene,
    microscope: Microscope,
    *,
    focus_um: float,
    model: str = "exact",
    window: Window | None = None,
    light: Illumination | None = None,
    samples: int = SAMPLES,
    step_um: float | None = None,
    lamp_aperture: float | None = None,
) -> FloatArray:
    """Return the noise-free image of a scene whose layers occlude one another.

    Parameters
    ----------
    scene, microscope, focus_um, model, window, light
        As in `microplan.optics.render.render.render`.
    samples : int
        Rays through each cell.
    step_um : float, optional
        Largest side of a cell; a pixel is cut into whole cells. Default: by the
        wavelength and the heights.
    lamp_aperture : float, optional
        Numerical aperture of light that comes through the objective (coaxial): higher
        bodies then shade the faces below, but not the background, which has no
        height; mirrors show them again, black. Default: light from all around, and
        no shade.

    Returns
    -------
    (rows, columns) float64 array
        Share of full scale, not clipped. As `render` where no blurred edges of two
        heights meet and nothing is shaded.

    Raises
    ------
    ValueError
        As in `render`, or if `samples` is below 1.

    Notes
    -----
    With B the layers blurred by the model, G their means over rays, M the mean over
    rays of the composited hard layers, and D the in-focus filter, the image is blend(B)
    + D[M] - blend(D[G]). That is blend(B) wherever only one layer is not uniform;
    D[composited layers] where all are in focus; and M for a wavelength of 0.
    """
    frame = window or full(microscope)
    whole = LitPart(scene=scene, microscope=microscope)
    lit = render(
        Scene(layers=(), background=1.0), microscope, focus_um=focus_um, model=model,
        window=frame, light=light,
    )  # fmt: skip
    tracing = (
        Tracing(
            scene=each.scene,
            microscope=each.microscope,
            focus_um=focus_um,
            model=model,
            tangents=slopes(each.microscope, samples),
            step_um=step_um or cell_um(each.scene.layers, each.microscope),
            lamp_aperture=lamp_aperture,
        )
        for each in lit_parts(whole, lamp_aperture, lambda *_: ())
    )
    image: FloatArray = np.sum([each.whole(frame) for each in tracing], axis=0)
    return image * lit


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracing:
    """Everything a traced image depends on but its window."""

    scene: Scene
    microscope: Microscope
    focus_um: float
    model: str
    tangents: FloatArray  # (N, 2), of the rays
    step_um: float  # largest side of a cell
    lamp_aperture: float | None = None

    def whole(self, frame: Window) -> FloatArray:
        """Return the image of a window, traced where layers meet, (rows, columns)."""

        def blurred(setting: Microscope, cut: Window) -> Sequence[Covered]:
            return cover(
                self.scene.layers, setting, focus_um=self.focus_um, model=self.model,
                window=cut,
            )  # fmt: skip

        stack = _sheets(blurred(self.microscope, frame))
        background = self.scene.background
        image = composite(stack, background, (frame.rows, frame.columns))
        part = meeting(stack) if self.lamp_aperture is None else _all(image, stack)
        if part is not None:
            image[part] = self.image(frame.part(*part), blurred)
        return image

    def image(self, crop: Window, blurred: Blurred) -> FloatArray:
        """Return the traced image of a crop, (rows, columns), share of full scale."""
        m, scene = self.microscope, self.scene
        cut = _cut(m, crop, self.step_um)
        h = cut.grid.step_um
        rim = math.ceil(_TAIL * m.wavelength_um / m.aperture / h)
        wide = cut.grid.grown(rim)
        stack = hard(scene.layers, wide, m, self.focus_um)
        covered = blurred(cut.fine, cut.window)
        blended = _sheets(covered)
        if self.lamp_aperture is not None:
            stack = self._with_mirrors(stack, wide)
            blended = self._blurred_mirrors(blended, covered, cut)
            lamp = replace(m, aperture=self.lamp_aperture)
            dark = self._shaded(stack, wide, lamp)
            blended = [
                replace(sheet, sends=sheet.sends - self._blur(loss, sheet.z_um, rim, h))
                for sheet, loss in zip(blended, dark, strict=True)
            ]
            stack = [
                replace(sheet, sends=sheet.sends - loss)
                for sheet, loss in zip(stack, dark, strict=True)
            ]
        fan = Fan(
            shape=wide.shape, step_um=h, tangents=self.tangents, focus_um=self.focus_um
        )
        extra = _hidden(stack, scene.background, m, fan)[rim:-rim, rim:-rim]
        image = composite(blended, scene.background, extra.shape) + extra
        return _pixels(image, cut.per_px, m)

    def _with_mirrors(
        self, stack: Sequence[LayerSheet], grid: Grid
    ) -> list[LayerSheet]:
        """Return hard sheets with their mirrors apart, and images in them."""
        layers = self.scene.layers
        make = partial(
            hard, grid=grid, microscope=self.microscope, focus_um=self.focus_um
        )
        return with_mirrors(stack, make(polished(layers)), layers, make)

    def _blurred_mirrors(
        self, stack: Sequence[LayerSheet], covered: Sequence[Covered], cut: _Cells
    ) -> list[LayerSheet]:
        """Return blurred sheets with their mirrors apart, and images in them."""

        def make(images: Sequence[Layer]) -> list[LayerSheet]:
            return _sheets(
                cover(
                    images,
                    cut.fine,
                    focus_um=self.focus_um,
                    model=self.model,
                    window=cut.window,
                )
            )

        shiny = polished([c.layer for c in covered])
        mirrors = sheets(shiny, [c.coverage for c in covered]) if shiny else []
        return with_mirrors(stack, mirrors, self.scene.layers, make)

    def _shaded(
        self, stack: Sequence[LayerSheet], grid: Grid, lamp: Microscope
    ) -> list[FloatArray]:
        """Return what each sheet sends less for the shade of higher ones."""
        found = []
        for sheet in stack:
            by = (sheet.covers.shape[0] - grid.shape[0]) // 2
            share = light_share(
                self.scene.layers,
                lamp,
                grid.grown(by),
                sheet.z_um,
                samples=len(self.tangents),
            )
            found.append(sheet.sends * (1 - share))
        return found

    def _blur(
        self, values: FloatArray, z_um: float, rim: int, step_um: float
    ) -> FloatArray:
        """Blur a raster by the model; what lies `rim` cells within the crop's grid."""
        m = self.microscope
        z_um -= self.focus_um
        table = tabulate(self.model, m, z_um)
        x = _frequencies(values.shape, step_um) / m.cutoff_per_um
        gain = np.where(x < 1, table.read(np.minimum(x, 1.0)), 0.0)
        by = rim + reach_cells(z_um, m, step_um)
        return _filtered(values, gain)[by:-by, by:-by]


def meeting(stack: Sequence[LayerSheet]) -> tuple[slice, slice] | None:
    """Return the rows and columns where blurred edges of two sheets meet, or None."""
    if len(stack) < 2:
        return None
    edges = [(s.covers > _UNIFORM) & (s.covers < 1 - _UNIFORM) for s in stack]
    return extent(np.sum(edges, axis=0) >= 2)


def _all(image: FloatArray, stack: Sequence[LayerSheet]) -> tuple[slice, slice] | None:
    """Return all rows and columns, or None where nothing can shade."""
    if len(stack) < 2:
        return None
    return slice(0, image.shape[0]), slice(0, image.shape[1])


def _sheets(covered: Sequence[Covered]) -> list[LayerSheet]:
    return sheets([c.layer for c in covered], [c.coverage for c in covered])


def cell_um(layers: Sequence[Layer], microscope: Microscope) -> float:
    """Return the largest admissible side of a cell, um."""
    airy = microscope.wavelength_um / microscope.aperture
    heights = sorted({layer.z_um for layer in layers})
    gaps = np.diff(np.array(heights, dtype=np.float64))
    parting = microscope.blur_diameter_um(float(gaps.min(initial=math.inf)))
    return min(max(_FINE * airy, parting * _PARTING), _COARSE * airy)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Cells:
    """The cells of a crop: whole numbers of them a pixel."""

    per_px: int
    fine: Microscope  # whose pixels are the cells
    window: Window  # of `fine`
    grid: Grid


def _cut(microscope: Microscope, crop: Window, step_um: float) -> _Cells:
    """Cut the pixels of `crop` into cells."""
    n = math.ceil(microscope.um_per_px / step_um - 1e-9)
    fine = replace(
        microscope,
        magnification=microscope.magnification * n,
        width_px=microscope.width_px * n,
        height_px=microscope.height_px * n,
        fill_factor=1.0,
        disc_side_um=microscope.shown_side_um,
    )
    window = Window(
        row=crop.row * n,
        column=crop.column * n,
        rows=crop.rows * n,
        columns=crop.columns * n,
    )
    return _Cells(per_px=n, fine=fine, window=window, grid=_grid(fine, window))


def _grid(fine: Microscope, window: Window) -> Grid:
    """Return the pixels of a window as cells."""
    cx, cy = axis_px(fine)
    h = fine.um_per_px
    return Grid(
        left_um=(window.column - 0.5 - cx) * h,
        top_um=(cy - window.row + 0.5) * h,
        step_um=h,
        shape=(window.rows, window.columns),
    )


def _hidden(
    stack: Sequence[LayerSheet], background: float, microscope: Microscope, fan: Fan
) -> FloatArray:
    """Return D[M] - blend(D[G])."""
    share = _frequencies(fan.shape, fan.step_um) / microscope.cutoff_per_um
    gain = diffraction(share)
    alone = [
        sheet.mapped(lambda raster, z_um: _filtered(fan.mean(raster, z_um), gain))
        for sheet in stack
    ]
    seen = _filtered(trace(stack, background, fan), gain)
    return seen - composite(alone, background, fan.shape)


def _frequencies(shape: tuple[int, ...], step_um: float) -> FloatArray:
    """Return the radial frequencies of a cosine transform, cycles/um."""
    v, u = (np.arange(size) / (2 * size * step_um) for size in shape)
    return np.hypot(u, v[:, None])


def _filtered(values: npt.NDArray[np.floating], gain: FloatArray) -> FloatArray:
    """Filter an array that is continued by its mirror images."""
    image: FloatArray = fft.idctn(fft.dctn(values.astype(np.float64)) * gain)
    return image


def _pixels(image: FloatArray, per_px: int, microscope: Microscope) -> FloatArray:
    """Return the means of cells over the light-sensitive squares of pixels."""
    edges = np.linspace(-0.5, 0.5, per_px + 1)
    half = math.sqrt(microscope.fill_factor) / 2
    weight = np.diff(np.clip(edges, -half, half)) / (2 * half)
    rows, columns = (size // per_px for size in image.shape)
    blocks = image.reshape(rows, per_px, columns, per_px)
    found: FloatArray = np.einsum("aibj,i,j->ab", blocks, weight, weight)
    return found
