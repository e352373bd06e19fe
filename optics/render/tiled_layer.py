"""A layer's spectrum on its tile, imaged in any view of a range."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.outline.clip import EdgeArrays
from microplan.optics.render.far_field import Far, make_far
from microplan.optics.render.layer_blending import Patch
from microplan.optics.render.pixels import PixelTile, choose_tile, sample_part, to_world
from microplan.optics.render.pruned_ifft import (
    Coefficients,
    Factors,
    Samples,
    Space,
    waves_at,
    weigh,
)
from microplan.optics.render.sampling import (
    Quadrant,
    Sampling,
    band_cut,
    halo_gain,
    margin_um,
    pixel_gain,
)
from microplan.optics.render.scene import Layer, Window
from microplan.optics.render.spectrum import Spectrum, spectrum
from microplan.optics.render.view_range import ROUNDING_PX, ImageView, Range
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import RadialTable, tabulate
from microplan.optics.transfer.wavefront import (
    disc_shift_um,
    most_defocus_um,
    transfer_change,
)

# Samples by which a tile must shrink before a correction is worth its time: an image of
# its own gains from 50 000 (a wall) or 250 000 (a gear) on, one of a stack sooner.
_WORTH = 100_000
_TABLES = 8  # an octave of cuts


@dataclass(slots=True)
class _Last:
    """What was found last: planes on both sides of a layer share it."""

    setting: tuple[float, float] | None = None  # defocus and zoom
    gain: Samples | None = None
    view: tuple[float, ...] | None = None  # the setting and the pixels' ends
    coverage: Samples | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TiledLayer:
    """A layer's spectrum on its tile, ready for the images of a range."""

    layer: Layer
    model: str
    sampling: Sampling
    tile: PixelTile
    spectrum: Spectrum
    values: Coefficients  # the spectrum's, in the sampling's precision
    quadrant: Quadrant
    far: Far | None  # None: the tile has all of the margin
    last: _Last = field(default_factory=_Last)
    space: Space = field(default_factory=Space)

    def patch(self, frame: Window, view: ImageView) -> Patch | None:
        """Return the blurred layer at the pixels of a window, None if none sees it.

        The coverage is overwritten by the next call, and not to be changed.
        """
        rows, columns = view.places(frame)
        r, c = (
            _within(rows, self.tile.rows.seen),
            _within(columns, self.tile.columns.seen),
        )
        if r.start >= r.stop or c.start >= c.stop:
            return None
        rows, columns = rows[r], columns[c]
        coverage = self._coverage(view, rows, columns)
        return Patch(layer=self.layer, rows=r, columns=c, coverage=coverage)

    def _coverage(
        self, view: ImageView, rows: FloatArray, columns: FloatArray
    ) -> Samples:
        """Return the blurred layer at pixels; even in z but for a wavefront error."""
        setting, last = (self._side_um(view), view.zoom), self.last
        ends = (*rows[[0, -1]].tolist(), *columns[[0, -1]].tolist())
        if last.coverage is not None and last.view == (*setting, *ends):
            return last.coverage
        if last.gain is None or last.setting != setting:
            last.gain, last.setting = self._gain(view), setting
        extra = None
        if self.far is not None:
            extra = self._correction(self.far, view, rows, columns)
        sampled = self._on_grid if view.zoom == 1 else self._at_places
        values, gain = self.values, last.gain
        if view.microscope.wavefront:
            values, gain = self._aberrated(view, gain), np.ones_like(gain)
        last.coverage = sampled(values, gain, extra, rows, columns)
        last.view = (*setting, *ends)
        return last.coverage

    def _aberrated(self, view: ImageView, gain: Samples) -> Coefficients:
        """Return the spectrum through a lens with a wavefront error, pixels too.

        Counted from where the lens shows the middle of a large disc in focus: what
        moves everything alike a calibrated camera takes off.
        """
        K, J = (size - 1 for size in gain.shape)
        found: Coefficients = weigh(self.values, gain)
        if self._defocus_um(view) > most_defocus_um(view.setting):
            return found  # no edge that an answer hangs on
        tile, up = self.spectrum.tile, np.r_[0 : K + 1, -K:0]
        u, v = np.arange(J + 1) / tile.width_um, up / tile.height_um
        change = transfer_change(view.setting, self._side_um(view), u, v)
        across, along = pixel_gain(view.setting, tile, (J, K))
        change *= across * along[np.abs(up), None]
        if view.microscope.halo is not None:
            change *= halo_gain(view.setting, tile, (J, K))[np.abs(up)]
        found += (self.values[up, : J + 1] * change).astype(found.dtype)
        x_um, y_um = disc_shift_um(view.setting)
        right, rise = np.exp(2j * np.pi * u * x_um), np.exp(2j * np.pi * v * y_um)
        found *= right.astype(found.dtype)
        found *= rise.astype(found.dtype)[:, None]
        return found

    def _at_places(
        self,
        values: Coefficients,
        gain: Samples,
        extra: Factors | None,
        rows: FloatArray,
        columns: FloatArray,
    ) -> Samples:
        """Return samples at any points, wave by wave."""
        x, y = self.tile.columns, self.tile.rows
        up = (y.start + y.count - 1 - rows) / y.count
        found = waves_at(weigh(values, gain), up, (columns - x.start) / x.count)
        if extra is not None:
            found += extra[0] @ extra[1]
        return found

    def _on_grid(
        self,
        values: Coefficients,
        gain: Samples,
        extra: Factors | None,
        rows: FloatArray,
        columns: FloatArray,
    ) -> Samples:
        """Return samples a pixel apart; between pixels by a phase ramp."""
        x, y = self.tile.columns, self.tile.rows
        r, c = round(rows[0]), round(columns[0])
        down, right = float(rows[0] - r), float(columns[0] - c)
        J, K = values.shape[1] - 1, values.shape[0] // 2
        if abs(right) > ROUNDING_PX:
            ramp = np.exp(2j * np.pi * right / x.count * np.arange(J + 1))
            values = values * ramp.astype(values.dtype)
        if abs(down) > ROUNDING_PX:
            ramp = np.exp(-2j * np.pi * down / y.count * np.r_[0 : K + 1, -K:0])
            values = values * ramp.astype(values.dtype)[:, None]
        seen = range(r, r + rows.size), range(c, c + columns.size)
        return sample_part(
            values, gain, self.tile, *seen, extra=extra, space=self.space
        )

    def _correction(
        self, far: Far, view: ImageView, rows: FloatArray, columns: FloatArray
    ) -> Factors:
        """Return what the tile's image lacks, in the sampling's precision."""
        table, cut_per_um = self._table(view)
        left, right = far.change(table, view.setting, cut_per_um, rows, columns)
        if self.sampling.single:
            return left.astype(np.float32), right.astype(np.float32)
        return left, right

    def _gain(self, view: ImageView) -> Samples:
        """Return transfer times pixel on a quadrant of the band."""
        table, cut_per_um = self._table(view)
        J, K = self.spectrum.within(cut_per_um)
        gain: Samples = self.quadrant.gain(table, (J, K), single=self.sampling.single)
        across, along = pixel_gain(view.setting, self.spectrum.tile, (J, K))
        np.multiply(gain, across, out=gain, casting="same_kind")
        np.multiply(gain, along[:, None], out=gain, casting="same_kind")
        if view.microscope.halo is not None:
            halo = halo_gain(view.setting, self.spectrum.tile, (J, K))
            np.multiply(gain, halo, out=gain, casting="same_kind")
        return gain

    def _table(self, view: ImageView) -> tuple[RadialTable, float]:
        """Return the transfer of a view and the highest frequency of its image."""
        setting, z_um = view.setting, self._defocus_um(view)
        cut = band_cut(self.model, setting, z_um, self.sampling.band_error)
        # a table for a little more than the cut serves the zooms nearby too
        steps = math.ceil(_TABLES * math.log2(cut))
        table = tabulate(self.model, setting, z_um, 2.0 ** (steps / _TABLES))
        return table, cut * setting.cutoff_per_um

    def _defocus_um(self, view: ImageView) -> float:
        return abs(self.layer.z_um - view.focus_um)

    def _side_um(self, view: ImageView) -> float:
        """Return the defocus, with its sign where images differ by it."""
        if not view.microscope.wavefront:
            return self._defocus_um(view)
        return self.layer.z_um - view.focus_um


def make_part(
    layer: Layer,
    edges: EdgeArrays,
    microscope: Microscope,
    *,
    reach: Range,
    model: str,
    window: Window,
    sampling: Sampling,
    shift_um: tuple[float, float] = (0.0, 0.0),
) -> TiledLayer | None:
    """Choose a layer's tile and transform its outline, displaced by `shift_um`.

    None where nothing of the layer comes near the window. The band is that of the
    plane nearest to the focus, the margin that of the plane farthest from it.
    """
    least_um, most_um = reach.defocus_um(layer.z_um)
    frame = reach.frame(microscope, window)
    wide, tile = _tiles(edges, microscope, most_um, frame, sampling, shift_um)
    if wide is None or tile is None:
        return None
    # the pixel's low-pass falls with the pixel: the largest zoom needs most
    largest = replace(
        microscope, magnification=microscope.magnification * reach.zoom[1]
    )
    cut = band_cut(model, largest, least_um, sampling.band_error)
    world, box = to_world(tile, microscope, shift_um)
    cut_per_um = cut * microscope.cutoff_per_um
    found = spectrum(edges, world, cut_per_um, box=box, single=sampling.single)
    values: Coefficients = found.values
    if sampling.single:  # a tile of one value has it in double precision
        values = values.astype(np.complex64, copy=False)
    far = None
    if tile is not wide:
        far = make_far(
            edges,
            microscope,
            (tile, found),
            wide,
            reach_um=margin_um(microscope, 0.0, sampling.near),
            shift_um=shift_um,
            single=sampling.single,
        )
    return TiledLayer(
        layer=layer,
        model=model,
        sampling=sampling,
        tile=tile,
        spectrum=found,
        values=values,
        quadrant=Quadrant.of(world, found.orders, microscope.cutoff_per_um),
        far=far,
    )


def _tiles(
    edges: EdgeArrays,
    microscope: Microscope,
    z_um: float,
    frame: Window,
    sampling: Sampling,
    shift_um: tuple[float, float],
) -> tuple[PixelTile | None, PixelTile | None]:
    """Return the tile with all of the margin, and the one that is worth computing."""
    margin = margin_um(microscope, z_um, sampling.margin)
    wide = choose_tile(edges, microscope, margin, frame, shift_um)
    if wide is None or sampling.margin <= sampling.near:
        return wide, wide
    apart = margin_um(microscope, z_um, sampling.near)
    near = choose_tile(edges, microscope, margin, frame, shift_um, apart_um=apart)
    if near is None or _samples(near) + _WORTH > _samples(wide):
        return wide, wide
    return wide, near


def _samples(tile: PixelTile) -> int:
    """Return the samples of a period."""
    return tile.rows.count * tile.columns.count


def _within(places: FloatArray, seen: range) -> slice:
    """Return which of rising positions lie in a range of pixels."""
    first = np.searchsorted(places, seen.start - ROUNDING_PX)
    last = np.searchsorted(places, seen.stop - 1 + ROUNDING_PX, side="right")
    return slice(int(first), int(last))
