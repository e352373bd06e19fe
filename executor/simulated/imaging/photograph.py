"""Photographs of solid scenes: the plane in focus by waves, the rest by rays."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from microplan.arrays import Box, FloatArray
from microplan.executor.simulated.imaging.diffraction import between, blurred
from microplan.executor.simulated.imaging.field_map import (
    FieldMap,
    chief_slopes,
    field_map,
    focus_at,
    light_over,
    seen_at,
)
from microplan.executor.simulated.imaging.halo import halo_window, with_halo
from microplan.executor.simulated.imaging.imaging_view import (
    Halo,
    ImagingView,
    LampLevel,
    PixelWindow,
    RaySampling,
)
from microplan.executor.simulated.imaging.rays.face_light import FAR_UM, FaceLight
from microplan.executor.simulated.imaging.rays.lattice import lattice_over
from microplan.executor.simulated.imaging.rays.marching import Solids
from microplan.executor.simulated.imaging.rays.pupil_rays import (
    beam_spread,
    pupil_slopes,
)
from microplan.executor.simulated.imaging.rays.ray_picture import RayPicture
from microplan.executor.simulated.imaging.refocus import Refocused
from microplan.executor.simulated.imaging.sharp_plane import SharpPlane, sharp_plane
from microplan.executor.simulated.imaging.solids.nearby import drawn_back
from microplan.executor.simulated.imaging.solids.solid_scene import (
    HEIGHT_DIGITS,
    MappedBody,
    SolidScene,
    mapped,
)
from microplan.executor.simulated.imaging.wavefront import ray_shifts

MERGE_UM = 1.0  # faces so near to the sharp plane are taken to be in it
SHARP_UM = 0.3  # nearer to focus, rays through the focal plane say nothing new
SKIRT_UM = 12.0  # beyond that: what lies outside sends less than .003 into it
NEAR_UM = 4.0  # round a region light is computed, in the skirt it is held on
GRAIN_UM = 8.0  # planes are computed on boxes of multiples of this, to be used again
TILE_PX = 220  # larger windows are taken in pieces
FOCUS_GRAIN_UM = 100.0  # a scene is prepared for a range of focus
BLURS_UM = (0.5, 10.0, 20.0)  # a plane has room for: a sweep of focus asks for few
KEPT = 4  # pieces of scenes: as many as the largest region of a look has
KEPT_PLANES = 2  # of each piece: one takes a quarter of a GiB and more
MOST_RAYS = 4_000_000  # through a plane's points
POINT_SHARE = 1.5  # cells of a plane's lattice to a point of it that is computed


def photograph(
    scene: SolidScene,
    view: ImagingView,
    window: PixelWindow | None = None,
    *,
    sampling: RaySampling | None = None,
) -> FloatArray:
    """Return what falls on the pixels, as a share of full scale.

    Parameters
    ----------
    scene : SolidScene
        Bodies and stage.
    view : ImagingView
        Microscope, light and camera.
    window : PixelWindow or None
        Part of the frame; None: all of it. It may reach beyond the frame.
    sampling : RaySampling or None
        How finely; None: two patterns of rays differ by some .001 rms on the example.

    Returns
    -------
    (rows, columns) float array
        A face of reflectance R with nothing around is R at a level of 1.
    """
    at = window or PixelWindow(
        row=0, column=0, rows=view.height_px, columns=view.width_px
    )
    lit = halo_window(view, at)
    return with_halo(_light(scene, view, lit, sampling or RaySampling()), view)


def _light(
    scene: SolidScene, view: ImagingView, at: PixelWindow, sampling: RaySampling
) -> FloatArray:
    """Return what falls on the pixels of a window without a halo."""
    image = np.empty((at.rows, at.columns))
    for row in _pieces(at.rows):
        for column in _pieces(at.columns):
            tile = PixelWindow(
                row=at.row + row.start,
                column=at.column + column.start,
                rows=row.stop - row.start,
                columns=column.stop - column.start,
            )
            image[row, column] = _tile(scene, view, tile, sampling)
    return image * light_over(view, at)


def _pieces(count: int) -> list[slice]:
    """Return equal pieces of a side, at most `TILE_PX` long."""
    edges = np.linspace(0, count, -(-count // TILE_PX) + 1).round().astype(int)
    return [slice(a, b) for a, b in pairwise(edges.tolist())]


def _tile(
    scene: SolidScene, view: ImagingView, tile: PixelWindow, sampling: RaySampling
) -> FloatArray:
    """Return a piece of the picture under a lamp of level 1."""
    pixels = field_map(view, tile)
    x0, y0, x1, y1 = pixels.box
    middle = (float(round((x0 + x1) / 2)), float(round((y0 + y1) / 2)))
    focus_um = focus_at(view, *middle)
    near, away = drawn_back(scene, middle, _reach_um(scene, view))
    work = _prepared(near, view, middle, sampling)
    moved = FieldMap(pixels.x_um - away[0], pixels.y_um - away[1])
    return work.picture(moved, view, focus_um)


class PhotographedScene:
    """A scene around one middle of an image; remembers planes and shading."""

    def __init__(
        self,
        scene: SolidScene,
        view: ImagingView,
        middle: tuple[float, float],
        sampling: RaySampling,
    ) -> None:
        self._view, self._middle = view, middle
        # no method of its own: a scene is large, and freed when nobody has it any more
        self._chief = partial(_chief_slopes, view, middle)
        self._stage_um = round(scene.stage_um, HEIGHT_DIGITS)
        self._stage_reflectance = scene.stage_reflectance
        self._sampling = sampling
        self._bodies = tuple(mapped(body, middle) for body in scene.bodies)
        self._pictures: dict[tuple[float | None, int], RayPicture] = {}
        self._solids: dict[float | None, Solids] = {}
        self._lights: dict[float | None, FaceLight] = {}
        self._planes: OrderedDict[tuple[float, Box], SharpPlane] = OrderedDict()

    def picture(
        self, pixels: FieldMap, view: ImagingView, focus_um: float
    ) -> FloatArray:
        """Return the picture at a focus, (rows, columns)."""
        at_um = self._sharp_um(pixels, focus_um)
        if at_um is None:
            return self._by_rays(pixels, focus_um)
        defocus_um = at_um - focus_um
        x, y = seen_at(view, pixels.x_um, pixels.y_um, defocus_um)
        x, y = x - self._middle[0], y - self._middle[1]
        blur_um = view.steepest * abs(defocus_um)
        room_um = next((v for v in BLURS_UM if blur_um <= v), blur_um)
        plane = self._plane(at_um, _grown(x, y, NEAR_UM + room_um))
        column, row = (
            (v - g[0]) / plane.step_um for v, g in ((x, plane.x_um), (y, plane.y_um))
        )
        bodies = self._snapped(at_um).bodies
        ends = (min(focus_um, at_um), max(focus_um, at_um))
        crossing = tuple(
            b for b in bodies if b.bottom_um <= ends[0] and ends[1] < b.top_um
        )
        plain = bool(crossing) or not view.wavefront
        if abs(defocus_um) <= SHARP_UM and plain:
            seen = blurred(plane.radiance, plane.step_um, view, defocus_um)
            return between(seen, column, row)
        flat = plane.uncut if crossing else plane.radiance
        image = between(blurred(flat, plane.step_um, view, defocus_um), column, row)
        aside = None if plain else ray_shifts(view, plane.slopes)
        rays = Refocused(plane, self._chief, blur_um, -defocus_um, crossing, aside)
        lens = view if plain else replace(view, wavefront=())
        rest = blurred(rays.remainder(), plane.step_um, lens, 0.0)
        px, py = pixels.x_um - self._middle[0], pixels.y_um - self._middle[1]
        column, row = (
            (v - g[0]) / plane.step_um for v, g in ((px, plane.x_um), (py, plane.y_um))
        )
        return image + between(rest, column, row)

    def _sharp_um(self, pixels: FieldMap, focus_um: float) -> float | None:
        """Return the height of the face nearest to focus that may be in the image."""
        x0, y0, x1, y1 = pixels.box
        x, y = np.meshgrid(np.linspace(x0, x1, 24), np.linspace(y0, y1, 24))
        x, y = x.ravel() - self._middle[0], y.ravel() - self._middle[1]
        gap_um = max(x1 - x0, y1 - y0) / 24
        best = self._stage_um
        for body in self._bodies:
            off_um = abs(body.top_um - focus_um)
            if off_um > abs(best - focus_um):
                continue
            near = body.distance(x, y, exact=True).min()
            if near < gap_um + SKIRT_UM + self._view.steepest * off_um:
                best = body.top_um
        return best if abs(best - focus_um) <= FAR_UM else None

    def _by_rays(self, pixels: FieldMap, focus_um: float) -> FloatArray:
        """Return the picture by rays alone."""
        solids = self._snapped(None)
        spacing = self._spacing(solids, focus_um, ())
        x, y = pixels.x_um - self._middle[0], pixels.y_um - self._middle[1]
        lattice = lattice_over(_grown(x, y, 0.0), spacing)
        picture = self._picture(None, lattice.points()[0].size)
        values = picture.through(*lattice.points(), focus_um)
        grid = values.reshape(len(lattice.y_um), len(lattice.x_um))
        return lattice.smooth_at(grid, x, y)

    def _plane(self, at_um: float, need: Box) -> SharpPlane:
        """Return the radiance in a plane over a box, computed before or now."""
        box = tuple(
            GRAIN_UM * (np.floor if i < 2 else np.ceil)(v / GRAIN_UM)
            for i, v in enumerate(need)
        )
        key = (at_um, (box[0], box[1], box[2], box[3]))
        if key not in self._planes:
            x0, y0, x1, y1 = key[1]
            spacing = self._sampling.plane_spacing_um
            points = round((x1 - x0) * (y1 - y0) / (POINT_SHARE * spacing**2))
            self._planes[key] = sharp_plane(
                self._picture(at_um, points), at_um, key[1], SKIRT_UM, self._sampling
            )
            while len(self._planes) > KEPT_PLANES:
                self._planes.popitem(last=False)
        self._planes.move_to_end(key)
        return self._planes[key]

    def _spacing(
        self, solids: Solids, focus_um: float, left_out: tuple[float, ...]
    ) -> float:
        """Return how far apart points may be where rays alone make the picture."""
        levels = {solids.stage_um}
        for body in solids.bodies:
            levels |= {body.top_um, body.bottom_um}
        away = [abs(z - focus_um) for z in levels if z not in left_out]
        blur_um = self._view.steepest * min(away, default=np.inf)
        fine = self._sampling
        return float(
            np.clip(fine.spacing * blur_um, fine.least_spacing_um, fine.most_spacing_um)
        )

    def _picture(self, sharp_um: float | None, points: int) -> RayPicture:
        """Return rays for so many points: fewer through each where there are many."""
        fine, solids = self._sampling, self._snapped(sharp_um)
        count = int(np.clip(MOST_RAYS / points, fine.least_rays, fine.rays))
        if (sharp_um, count) not in self._pictures:
            slopes = pupil_slopes(self._view, count, turn_rad=fine.turn_rad)
            self._pictures[sharp_um, count] = RayPicture(
                solids=solids,
                light=self._lights[sharp_um],
                slopes=slopes,
                spread=beam_spread(self._view, count),
                chief=self._chief,
                aside=ray_shifts(self._view, slopes) if sharp_um is None else None,
            )
        return self._pictures[sharp_um, count]

    def _snapped(self, sharp_um: float | None) -> Solids:
        """Return the bodies, with what is near to the sharp plane put into it."""
        if sharp_um not in self._solids:
            bodies = tuple(_put_into(body, sharp_um) for body in self._bodies)
            solids = Solids(bodies, _snapped(self._stage_um, sharp_um))
            high_um = solids.sky_um - solids.stage_um
            # no window is larger than a tile, and no ray goes farther aside
            reach = TILE_PX / self._view.px_per_um + 2 * self._view.steepest * high_um
            self._solids[sharp_um] = solids
            self._lights[sharp_um] = FaceLight(
                solids, self._stage_reflectance, self._view, self._sampling,
                (-reach, -reach, reach, reach), sharp_um,
            )  # fmt: skip
        return self._solids[sharp_um]


def _chief_slopes(
    view: ImagingView, middle: tuple[float, float], x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return slopes of the middle rays at points from an image's middle."""
    return chief_slopes(view, x + middle[0], y + middle[1])


_RECENT: OrderedDict[object, PhotographedScene] = OrderedDict()


def _prepared(
    scene: SolidScene,
    view: ImagingView,
    middle: tuple[float, float],
    sampling: RaySampling,
) -> PhotographedScene:
    """Return a scene's planes and shading, from an earlier picture if there is one."""
    about_um = FOCUS_GRAIN_UM * round(view.focus_um / FOCUS_GRAIN_UM)
    lasting = replace(
        view, focus_um=about_um, shift_um=(0.0, 0.0), lamp=LampLevel(), halo=Halo()
    )
    key = (scene, lasting, middle, sampling)
    if key not in _RECENT:
        _RECENT[key] = PhotographedScene(scene, lasting, middle, sampling)
        while len(_RECENT) > KEPT:
            _RECENT.popitem(last=False)
    _RECENT.move_to_end(key)
    return _RECENT[key]


def _reach_um(scene: SolidScene, view: ImagingView) -> float:
    """Return how far from an image's middle a body may matter.

    From the farthest pixel of a tile and its skirt light goes down to the stage and up
    again to the highest face.
    """
    high_um = max((body.top_um for body in scene.bodies), default=scene.stage_um)
    most_um = max(high_um, view.focus_um) - min(scene.stage_um, view.focus_um)
    most_um += FOCUS_GRAIN_UM / 2
    tile_um = TILE_PX / view.px_per_um
    return tile_um + SKIRT_UM + NEAR_UM + 2 * view.steepest * most_um


def _put_into(body: MappedBody, sharp_um: float | None) -> MappedBody:
    """Return a body whose heights near the sharp plane are in it."""
    return replace(
        body,
        top_um=_snapped(body.top_um, sharp_um),
        bottom_um=_snapped(body.bottom_um, sharp_um),
    )


def _snapped(height_um: float, sharp_um: float | None) -> float:
    """Return a height, or the sharp plane's if that is near."""
    if sharp_um is None or abs(height_um - sharp_um) > MERGE_UM:
        return height_um
    return sharp_um


def _grown(x: FloatArray, y: FloatArray, by_um: float) -> Box:
    """Return the box of points with a skirt."""
    return (
        float(x.min()) - by_um, float(y.min()) - by_um,
        float(x.max()) + by_um, float(y.max()) + by_um,
    )  # fmt: skip
