"""Prepared scenes: one spectrum a layer for many focus heights, shifts, zooms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.outline.clip import to_edges
from microplan.optics.render.layer_blending import Patch, blend_layers, light_up
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Illumination, Scene, Window
from microplan.optics.render.tiled_layer import TiledLayer, make_part
from microplan.optics.render.view_range import ImageView, Range, full
from microplan.optics.transfer.microscope import Microscope
from microplan.optics.transfer.models import find_model

_PLAIN = Illumination()


@dataclass(frozen=True, slots=True, kw_only=True)
class PreparedScene:
    """A scene with the spectra of its parts, see `prepare`."""

    scene: Scene
    microscope: Microscope
    window: Window
    reach: Range
    parts: tuple[TiledLayer, ...]  # those that come near the window

    def image(
        self,
        *,
        focus_um: float,
        shift_um: tuple[float, float] = (0.0, 0.0),
        zoom: float = 1.0,
        light: Illumination = _PLAIN,
        also: Sequence[Patch] = (),
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
        also : sequence of Patch
            More layers, by `patches` of another scene at the same focus and zoom.

        Returns
        -------
        (rows, columns) float64 array
            As `microplan.optics.render.render.render`, within the predicted errors.

        Raises
        ------
        ValueError
            If the image lies beyond the prepared range.
        """
        view = self._view(focus_um, shift_um, zoom)
        image = np.empty((self.window.rows, self.window.columns))
        self.draw(image, view, also)
        light_up(image, self.microscope, self.window, light)
        return image

    def patches(
        self,
        *,
        focus_um: float,
        shift_um: tuple[float, float] = (0.0, 0.0),
        zoom: float = 1.0,
    ) -> tuple[Patch, ...]:
        """Return the layers blurred, for images that share them; as in `image`."""
        view = self._view(focus_um, shift_um, zoom)
        found = (part.patch(self.window, view) for part in self.parts)
        return tuple(
            replace(patch, coverage=patch.coverage.copy())
            for patch in found
            if patch is not None
        )

    def draw(
        self, image: FloatArray, view: ImageView, also: Sequence[Patch] = ()
    ) -> None:
        """Write the unlit image of a view into (rows, columns), share of full scale."""
        found = (part.patch(self.window, view) for part in self.parts)
        fresh = [patch for patch in found if patch is not None]
        blend_layers(image, [*also, *fresh], self.scene.background)

    def _view(
        self, focus_um: float, shift_um: tuple[float, float], zoom: float
    ) -> ImageView:
        """Return a view; ValueError beyond the prepared range."""
        if not self.reach.holds(focus_um, shift_um, zoom):
            raise ValueError(
                f"prepared for {self.reach}, got focus_um {focus_um}, "
                f"shift_um {shift_um}, zoom {zoom}"
            )
        return ImageView(
            microscope=self.microscope, focus_um=focus_um, shift_um=shift_um, zoom=zoom
        )


def prepare(
    scene: Scene,
    microscope: Microscope,
    reach: Range,
    *,
    model: str = "exact",
    window: Window | None = None,
    sampling: Sampling | None = None,
    shift_um: tuple[float, float] = (0.0, 0.0),
) -> PreparedScene:
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
        The OTF model of defocus, a key of `microplan.optics.transfer.models.MODELS`.
    window : Window, optional
        The part of the frame wanted. Default: all.
    sampling : Sampling, optional
        Band, margin and precision to compute with; by default the usual ones in
        single precision.
    shift_um : (x, y)
        Displacement from which the images' own are counted.

    Returns
    -------
    PreparedScene
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
    return PreparedScene(
        scene=scene,
        microscope=microscope,
        window=frame,
        reach=reach,
        parts=tuple(part for part in found if part is not None),
    )
