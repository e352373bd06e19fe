"""Scenes transformed once for many images: focus, shift and zoom change, parts stay."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from optics.clip import Edges, to_edges
from optics.folding import Coefficients, Samples, Space, waves_at, weigh
from optics.gain import Quadrant, pixel_gain
from optics.laying import Patch, lay, light_up
from optics.microscope import Microscope
from optics.models import find_model, tabulate
from optics.pixels import PixelTile, axis_px, choose_tile, sample_part, to_world
from optics.sampling import Sampling, band_cut, margin_um
from optics.scene import Illumination, Layer, Scene, Window
from optics.spectrum import Spectrum, spectrum

FloatArray = npt.NDArray[np.float64]

_PLAIN = Illumination()
_ROUNDING_PX = 1e-6  # of pixel positions after conversions; moves no edge visibly


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """What images a scene is prepared for."""

    focus_um: tuple[float, float]  # lowest and highest world height in focus
    shift_um: float = 0.0  # largest displacement along an axis, of either sign
    zoom: tuple[float, float] = (1.0, 1.0)  # least and largest, over the microscope's

    def __post_init__(self) -> None:
        values = (*self.focus_um, self.shift_um, *self.zoom)
        if not all(math.isfinite(value) for value in values):
            raise ValueError(f"focus_um, shift_um and zoom must be finite, got {self}")
        if self.focus_um[0] > self.focus_um[1] or self.shift_um < 0:
            raise ValueError(f"a range runs from low to high, got {self}")
        if not 0 < self.zoom[0] <= self.zoom[1]:
            raise ValueError(f"zoom must be positive, from low to high, got {self}")

    def holds(
        self, focus_um: float, shift_um: tuple[float, float], zoom: float
    ) -> bool:
        """Tell whether an image lies in the range."""
        return (
            self.focus_um[0] <= focus_um <= self.focus_um[1]
            and max(abs(shift_um[0]), abs(shift_um[1])) <= self.shift_um
            and self.zoom[0] <= zoom <= self.zoom[1]
        )

    def defocus_um(self, z_um: float) -> tuple[float, float]:
        """Return the least and the largest distance of a height from the focus."""
        low, high = z_um - self.focus_um[0], z_um - self.focus_um[1]
        nearest = 0.0 if low * high <= 0 else min(abs(low), abs(high))
        return nearest, max(abs(low), abs(high))

    def frame(self, microscope: Microscope, window: Window) -> Window:
        """Return what may be seen through `window`, in pixels of the microscope."""
        cx, cy = axis_px(microscope)
        reach = self.shift_um * microscope.px_per_um - _ROUNDING_PX

        def grown(first: int, count: int, center: float) -> tuple[int, int]:
            ends = [
                (edge - center) / zoom
                for zoom in self.zoom
                for edge in (first, first + count - 1)
            ]
            low = math.floor(center + min(ends) - reach)
            return low, math.ceil(center + max(ends) + reach) - low + 1

        column, columns = grown(window.column, window.columns, cx)
        row, rows = grown(window.row, window.rows, cy)
        return Window(row=row, column=column, rows=rows, columns=columns)


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """One image of a range: where its pixels lie, and at what magnification."""

    microscope: Microscope  # as prepared
    focus_um: float
    shift_um: tuple[float, float] = (0.0, 0.0)
    zoom: float = 1.0

    @property
    def setting(self) -> Microscope:
        """Return the microscope at the view's own magnification."""
        m = self.microscope
        if self.zoom == 1:
            return m
        return replace(m, magnification=m.magnification * self.zoom)

    def places(self, frame: Window) -> tuple[FloatArray, FloatArray]:
        """Return where a window's rows and columns lie, px of the prepared frame."""
        cx, cy = axis_px(self.microscope)
        k = self.microscope.px_per_um
        rows = (np.arange(frame.rows) + (frame.row - cy)) / self.zoom
        columns = (np.arange(frame.columns) + (frame.column - cx)) / self.zoom
        x_um, y_um = self.shift_um
        return np.asarray(cy + rows + k * y_um), np.asarray(cx + columns - k * x_um)


@dataclass(slots=True)
class _Last:
    """The gain used last: planes on both sides of a layer share theirs."""

    key: tuple[float, float] | None = None
    gain: Samples | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A layer's spectrum on its tile, ready for the images of a range."""

    layer: Layer
    edges: Edges
    model: str
    sampling: Sampling
    tile: PixelTile
    spectrum: Spectrum
    values: Coefficients  # the spectrum's, in the sampling's precision
    quadrant: Quadrant
    last: _Last = field(default_factory=_Last)
    space: Space = field(default_factory=Space)

    def patch(self, frame: Window, view: View) -> Patch | None:
        """Return the blurred layer at the pixels of a window, None if none sees it.

        The coverage is overwritten by the next call.
        """
        rows, columns = view.places(frame)
        r, c = (
            _within(rows, self.tile.rows.seen),
            _within(columns, self.tile.columns.seen),
        )
        if r.start >= r.stop or c.start >= c.stop:
            return None
        gain = self._shared_gain(view)
        if view.zoom == 1:
            coverage = self._on_grid(gain, rows[r], columns[c])
        else:
            x, y = self.tile.columns, self.tile.rows
            up = (y.start + y.count - 1 - rows[r]) / y.count
            right = (columns[c] - x.start) / x.count
            coverage = waves_at(weigh(self.values, gain), up, right)
        return Patch(layer=self.layer, rows=r, columns=c, coverage=coverage)

    def _on_grid(self, gain: Samples, rows: FloatArray, columns: FloatArray) -> Samples:
        """Return samples a pixel apart; between pixels by a phase ramp."""
        x, y = self.tile.columns, self.tile.rows
        r, c = round(rows[0]), round(columns[0])
        down, right = float(rows[0] - r), float(columns[0] - c)
        values, (J, K) = self.values, self.spectrum.orders
        if abs(right) > _ROUNDING_PX:
            ramp = np.exp(2j * np.pi * right / x.count * np.arange(J + 1))
            values = values * ramp.astype(values.dtype)
        if abs(down) > _ROUNDING_PX:
            ramp = np.exp(-2j * np.pi * down / y.count * np.r_[0 : K + 1, -K:0])
            values = values * ramp.astype(values.dtype)[:, None]
        seen = range(r, r + rows.size), range(c, c + columns.size)
        return sample_part(values, gain, self.tile, *seen, space=self.space)

    def _shared_gain(self, view: View) -> Samples:
        """Return the gain of a view; it is even in z."""
        z_um = abs(self.layer.z_um - view.focus_um)
        if self.last.gain is None or self.last.key != (z_um, view.zoom):
            self.last.gain = self._gain(view.setting, z_um)
            self.last.key = (z_um, view.zoom)
        return self.last.gain

    def _gain(self, setting: Microscope, z_um: float) -> Samples:
        """Return transfer times pixel on a quadrant of the band."""
        cut = band_cut(self.model, setting, z_um, self.sampling.band_error)
        J, K = self.spectrum.within(cut * setting.cutoff_per_um)
        table = tabulate(self.model, setting, z_um, cut)
        gain: Samples = self.quadrant.gain(table, (J, K), single=self.sampling.single)
        across, along = pixel_gain(setting, self.spectrum.tile, (J, K))
        np.multiply(gain, across, out=gain, casting="same_kind")
        np.multiply(gain, along[:, None], out=gain, casting="same_kind")
        return gain


def make_part(
    layer: Layer,
    edges: Edges,
    microscope: Microscope,
    *,
    reach: Range,
    model: str,
    window: Window,
    sampling: Sampling,
    shift_um: tuple[float, float] = (0.0, 0.0),
) -> Part | None:
    """Choose a layer's tile and transform its outline, displaced by `shift_um`.

    None where nothing of the layer comes near the window. The band is that of the
    plane nearest to the focus, the margin that of the plane farthest from it.
    """
    near, far = reach.defocus_um(layer.z_um)
    margin = margin_um(microscope, far, sampling.margin)
    frame = reach.frame(microscope, window)
    tile = choose_tile(edges, microscope, margin, frame, shift_um)
    if tile is None:
        return None
    # the pixel's low-pass falls with the pixel: the largest zoom needs most
    largest = replace(
        microscope, magnification=microscope.magnification * reach.zoom[1]
    )
    cut = band_cut(model, largest, near, sampling.band_error)
    world, box = to_world(tile, microscope, shift_um)
    found = spectrum(edges, world, cut * microscope.cutoff_per_um, box=box)
    values: Coefficients = found.values
    if sampling.single:
        values = found.values.astype(np.complex64)
    return Part(
        layer=layer,
        edges=edges,
        model=model,
        sampling=sampling,
        tile=tile,
        spectrum=found,
        values=values,
        quadrant=Quadrant.of(world, found.orders, microscope.cutoff_per_um),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Prepared:
    """A scene with the spectra of its parts, see `prepare`."""

    scene: Scene
    microscope: Microscope
    window: Window
    reach: Range
    model: str
    sampling: Sampling
    parts: tuple[Part, ...]  # those that come near the window
    shift_um: tuple[float, float]

    def image(
        self,
        *,
        focus_um: float,
        shift_um: tuple[float, float] = (0.0, 0.0),
        zoom: float = 1.0,
        light: Illumination = _PLAIN,
    ) -> FloatArray:
        """Return one noise-free image.

        Parameters
        ----------
        focus_um : float
            World height of the plane in focus.
        shift_um : (x, y)
            Displacement of the whole image, um in object space.
        zoom : float
            Magnification over that of the microscope; other zooms than 1 take a few
            times as long, as no fast transform fits their pixels.
        light : Illumination
            Gain and gradient of the light.

        Returns
        -------
        (rows, columns) float64 array
            As `optics.render.render`, within the predicted errors.

        Raises
        ------
        ValueError
            If the image lies beyond the prepared range.
        """
        if not self.reach.holds(focus_um, shift_um, zoom):
            raise ValueError(
                f"prepared for {self.reach}, got focus_um {focus_um}, "
                f"shift_um {shift_um}, zoom {zoom}"
            )
        image = np.empty((self.window.rows, self.window.columns))
        view = View(
            microscope=self.microscope, focus_um=focus_um, shift_um=shift_um, zoom=zoom
        )
        self.draw(image, view)
        light_up(image, self.microscope, self.window, light)
        return image

    def draw(self, image: FloatArray, view: View) -> None:
        """Write the unlit image of a view into (rows, columns), in place."""
        found = (part.patch(self.window, view) for part in self.parts)
        lay(image, [p for p in found if p is not None], self.scene.background)

    def turned(
        self, theta_rad: float, *, names: Collection[str] | None = None
    ) -> Prepared:
        """Return the scene with layers turned about the world's origin.

        Their edges are turned and transformed again, the others' spectra are kept.

        Parameters
        ----------
        theta_rad : float
            Counter-clockwise.
        names : collection of str, optional
            Of the layers that turn. Default: all.
        """
        parts = []
        for layer in self.scene.layers:
            old = [part for part in self.parts if part.layer is layer]
            if names is not None and layer.name not in names:
                parts += old
                continue
            edges = old[0].edges if old else to_edges(layer.outline)
            new = make_part(
                layer,
                edges.placed(0.0, 0.0, theta_rad),
                self.microscope,
                reach=self.reach,
                model=self.model,
                window=self.window,
                sampling=self.sampling,
                shift_um=self.shift_um,
            )
            parts += [new] if new else []
        return replace(self, parts=tuple(parts))


def prepare(
    scene: Scene,
    microscope: Microscope,
    reach: Range,
    *,
    model: str = "exact",
    window: Window | None = None,
    sampling: Sampling | None = None,
    shift_um: tuple[float, float] = (0.0, 0.0),
) -> Prepared:
    """Return a scene ready for many images.

    Parameters
    ----------
    scene : Scene
        Layers in the world frame over a uniform background.
    microscope : Microscope
        The optical setting; the camera's axis is the world's origin.
    reach : Range
        Focus heights, shifts and zooms that will be asked for: they decide about tile
        and band, so a wide range makes every image slower.
    model : str
        The defocus law, a key of `optics.models.MODELS`.
    window : Window, optional
        The part of the frame wanted. Default: all.
    sampling : Sampling, optional
        Band, margin and precision to compute with; by default the usual ones in
        single precision.
    shift_um : (x, y)
        Displacement from which the images' own are counted.

    Returns
    -------
    Prepared
        One spectrum for each layer near the window. A focus plane is another gain, a
        shift a phase ramp, a zoom other sampling points of that spectrum.

    Raises
    ------
    ValueError
        If the model is unknown.
    """
    find_model(model)
    frame = window or full(microscope)
    chosen = sampling or Sampling(single=True)
    found = (
        make_part(
            layer,
            to_edges(layer.outline),
            microscope,
            reach=reach,
            model=model,
            window=frame,
            sampling=chosen,
            shift_um=shift_um,
        )
        for layer in scene.layers
    )
    return Prepared(
        scene=scene,
        microscope=microscope,
        window=frame,
        reach=reach,
        model=model,
        sampling=chosen,
        parts=tuple(part for part in found if part is not None),
        shift_um=shift_um,
    )


def full(microscope: Microscope) -> Window:
    """Return the whole frame."""
    return Window(
        row=0, column=0, rows=microscope.height_px, columns=microscope.width_px
    )


def _within(places: FloatArray, seen: range) -> slice:
    """Return which of rising places lie in a range of pixels."""
    first = np.searchsorted(places, seen.start - _ROUNDING_PX)
    last = np.searchsorted(places, seen.stop - 1 + _ROUNDING_PX, side="right")
    return slice(int(first), int(last))
