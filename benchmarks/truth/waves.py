"""Images of single points by waves: angular spectrum through the bodies of a scene.

The wave that the pupil would send to an image point goes down from body to body. What
it brings to a face comes back, by reciprocity, as the face's light in that point. Of
the cell and of the compiler come numbers alone: outlines, heights and reflectances.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy import fft
from skimage.draw import polygon

from microplan.arrays import Float32Array, FloatArray
from microplan.executor.simulated.imaging.imaging_view import ImagingView
from microplan.executor.simulated.imaging.solids.solid_scene import (
    SolidBody,
    SolidScene,
)

ComplexArray = npt.NDArray[np.complexfloating]

STEP_UM = 0.2  # of the grid; the power of a wave past an edge needs less than .36 um
FINER = 4  # cells of a raster in one of the grid, each way
SLICE_UM = 20.0  # between cuts through a body: a ray goes 9 um aside on the way
MARGIN_UM = 24.0  # round the cone: what diffraction sends farther is below .003
LAMP_RAYS = 120  # through the lamp, for the light on faces
COARSE = 4  # points of the grid in one of the light's, each way
NEAR_UM = 400.0  # bodies farther off neither send nor hide light
CHORD_RAD = 0.02  # of a circle's polygon: .002 um at R 45


@dataclass(frozen=True, slots=True, kw_only=True)
class WaveGrid:
    """Points a step apart round a middle, rows up, and their tile's frequencies."""

    middle_um: tuple[float, float]
    side: int
    fx: Float32Array  # (side, side) per um
    fy: Float32Array
    kz: FloatArray  # (side, side) rad per um, along z


@dataclass(frozen=True, slots=True, kw_only=True)
class WaveScene:
    """Masks of bodies on a grid round a point, and the light on their faces."""

    scene: SolidScene
    view: ImagingView
    grid: WaveGrid
    masks: tuple[Float32Array, ...]  # coverage by body, (side, side)
    lights: Mapping[float, Float32Array]  # share of the lamp's cone by height

    def image(self, x_um: float, y_um: float) -> float:
        """Return the light in an image point without pixels, share of full scale."""
        scene, at_um = self.scene, _heights(self.scene)[0]
        wave = self._sent(x_um, y_um, at_um)
        whole, found = float((np.abs(wave) ** 2).sum()), 0.0
        for z_um in _heights(scene):
            wave = self._carried(wave, at_um - z_um)
            at_um = z_um
            for body, mask in zip(scene.bodies, self.masks, strict=True):
                if body.top_um == z_um:
                    power = np.abs(wave) ** 2 * mask * self.lights[z_um]
                    found += body.reflectance * float(power.sum())
                    # of a cell in part covered that part of the power is stopped
                    wave = wave * np.sqrt(np.maximum(1 - mask, 0))
                elif body.bottom_um <= z_um < body.top_um:
                    wave = wave * (mask < 0.5)
        rest = np.abs(wave) ** 2 * self.lights[scene.stage_um]
        found += scene.stage_reflectance * float(rest.sum())
        return self.view.lamp.level * found / whole

    def _sent(self, x_um: float, y_um: float, at_um: float) -> ComplexArray:
        """Return the wave at a height that comes together at a point in focus."""
        grid, view = self.grid, self.view
        inside = np.hypot(grid.fx, grid.fy) * view.wavelength_um <= view.aperture
        x, y = (
            v - m + grid.side / 2 * STEP_UM
            for v, m in zip((x_um, y_um), grid.middle_um, strict=True)
        )
        phase = -2 * math.pi * (grid.fx * x + grid.fy * y)
        phase = phase - grid.kz * (at_um - view.focus_um)
        # as bright for equal areas of sines: no apodisation
        sent = (inside * np.exp(1j * phase)).astype(np.complex64)
        wave: ComplexArray = fft.ifft2(sent)
        return wave

    def _carried(self, wave: ComplexArray, down_um: float) -> ComplexArray:
        """Return a wave so much lower."""
        if down_um == 0:
            return wave
        turn = np.exp(1j * self.grid.kz * down_um).astype(np.complex64)
        gone: ComplexArray = fft.ifft2(fft.fft2(wave) * turn)
        return gone


def wave_scene(
    scene: SolidScene,
    view: ImagingView,
    middle_um: tuple[float, float],
    reach_um: float,
) -> WaveScene:
    """Return a scene for image points within `reach_um` of a middle."""
    bodies = tuple(b for b in scene.bodies if b.away_um(*middle_um) < NEAR_UM)
    near = SolidScene(
        bodies=bodies, stage_um=scene.stage_um,
        stage_reflectance=scene.stage_reflectance,
    )  # fmt: skip
    heights = _heights(near)
    away = max(abs(z - view.focus_um) for z in (heights[0], heights[-1]))
    half = reach_um + view.steepest * away + MARGIN_UM
    blocks = fft.next_fast_len(math.ceil(2 * half / (COARSE * STEP_UM)))
    grid = _grid(middle_um, COARSE * blocks, view)
    masks = tuple(_raster(body, grid) for body in bodies)
    faces = {near.stage_um, *(body.top_um for body in bodies)}
    return WaveScene(
        scene=near, view=view, grid=grid, masks=masks,
        lights={z: _light(z, near, masks, view) for z in faces},
    )  # fmt: skip


def _grid(middle_um: tuple[float, float], side: int, view: ImagingView) -> WaveGrid:
    """Return a grid of so many points a side."""
    f = fft.fftfreq(side, STEP_UM)
    fx, fy = np.meshgrid(f, f)
    n = view.medium_index / view.wavelength_um
    kz = 2 * math.pi * np.sqrt(np.maximum(n**2 - fx**2 - fy**2, 0.0))
    return WaveGrid(
        middle_um=middle_um, side=side, fx=fx.astype(np.float32),
        fy=fy.astype(np.float32), kz=kz,
    )  # fmt: skip


def _heights(scene: SolidScene) -> list[float]:
    """Return where a wave is cut, from the highest face to the stage."""
    found = {scene.stage_um}
    for body in scene.bodies:
        parts = max(1, math.ceil((body.top_um - body.bottom_um) / SLICE_UM))
        found |= set(np.linspace(body.top_um, body.bottom_um, parts + 1).tolist())
    return sorted(found, reverse=True)


def _light(
    at_um: float, scene: SolidScene, masks: Sequence[Float32Array], view: ImagingView
) -> Float32Array:
    """Return the share of the lamp's rays that reach a height, (side, side)."""
    above = [
        (body, mask)
        for body, mask in zip(scene.bodies, masks, strict=True)
        if body.top_um > at_um
    ]
    if not above or view.lamp_share == 0:
        return np.ones((1, 1), dtype=np.float32)
    above = [(body, _coarse(mask)) for body, mask in above]
    total = np.zeros_like(above[0][1])
    for u, v in _directions(view):
        left = np.ones_like(total)
        for body, mask in above:
            hides = np.zeros_like(total)
            for z_um in _cuts(body, at_um):
                way = (z_um - at_um) / (STEP_UM * COARSE)
                hides = np.maximum(hides, _moved(mask, way * u, way * v))
            left *= 1 - hides
        total += left / LAMP_RAYS
    return np.repeat(np.repeat(total, COARSE, axis=0), COARSE, axis=1)


def _coarse(mask: Float32Array) -> Float32Array:
    """Return the mean of blocks of a mask."""
    side = len(mask) // COARSE
    blocks = mask.reshape(side, COARSE, side, COARSE)
    return np.asarray(blocks.mean(axis=(1, 3)), dtype=np.float32)


def _directions(view: ImagingView) -> Iterator[tuple[float, float]]:
    """Yield slopes of the lamp's rays: rings of a disc of sines, each evenly."""
    rings = round(math.sqrt(LAMP_RAYS / 3.2))
    areas = np.arange(rings) + 0.5
    counts = np.round(LAMP_RAYS * areas / areas.sum()).astype(int)
    counts[-1] += LAMP_RAYS - counts.sum()
    edge = np.concatenate([[0], np.cumsum(counts)]) / LAMP_RAYS
    for k, count in enumerate(counts):
        share = math.sqrt((edge[k] + edge[k + 1]) / 2)
        sine = view.aperture * view.lamp_share * share / view.medium_index
        slope = sine / math.sqrt(1 - sine**2)
        for i in range(count):
            turn = 2 * math.pi * (i + 0.5 * (k % 2)) / count
            yield slope * math.cos(turn), slope * math.sin(turn)


def _cuts(body: SolidBody, above_um: float) -> FloatArray:
    """Return heights of a body at which rays from below are stopped."""
    low = max(body.bottom_um, above_um)
    parts = max(1, math.ceil((body.top_um - low) / SLICE_UM))
    return np.linspace(low, body.top_um, parts + 1)


def _moved(mask: Float32Array, across: float, up: float) -> Float32Array:
    """Return a mask as seen so many cells aside; beyond its border it goes on."""
    matrix = np.array([[1.0, 0.0, across], [0.0, 1.0, up]])
    moved = cv2.warpAffine(
        mask, matrix, mask.shape[::-1], borderMode=cv2.BORDER_REPLICATE,
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
    )  # fmt: skip
    return np.asarray(moved, dtype=np.float32)


def _raster(body: SolidBody, grid: WaveGrid) -> Float32Array:
    """Return a body's coverage of the grid's cells, (side, side), rows up."""
    turn, side, middle_um = body.pose.theta_rad, grid.side, grid.middle_um
    c, s = math.cos(turn), math.sin(turn)
    fine = side * FINER
    canvas = np.zeros((fine, fine), dtype=np.bool_)
    for ring in body.outline.rings:
        x, y = _corners(ring).T
        wx = c * x - s * y + body.pose.x_um - middle_um[0]
        wy = s * x + c * y + body.pose.y_um - middle_um[1]
        # the grid's point i lies at (i - side / 2) steps, in its cell's middle
        cells = (np.c_[wx, wy] / STEP_UM + side / 2 + 0.5) * FINER - 0.5
        # points inside: what paints outlines paints their rims too
        canvas[polygon(cells[:, 1], cells[:, 0], canvas.shape)] ^= True  # type: ignore[no-untyped-call]
    blocks = canvas.reshape(side, FINER, side, FINER)
    covered = blocks.mean(axis=(1, 3), dtype=np.float32)
    return np.asarray(covered, dtype=np.float32)


def _corners(ring: Sequence[Sequence[float]]) -> FloatArray:
    """Return a ring's corners, arcs as short chords, (N, 2) um."""
    points = []
    for edge in ring:
        if len(edge) == 4:
            points.append(np.array([edge[:2]]))
            continue
        x, y, radius, start, sweep = edge
        count = max(2, math.ceil(abs(sweep) / CHORD_RAD))
        angle = start + sweep * np.arange(count) / count
        points.append(np.c_[x + radius * np.cos(angle), y + radius * np.sin(angle)])
    return np.concatenate(points)
