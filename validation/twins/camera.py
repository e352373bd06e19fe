"""A camera with a response curve, cut-off black and noise by level; dust and halo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

from validation.twins.raster import Floats, Grid, Lens, Pose, blurred, coverage


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """What is photographed: rings of parts, as bright as each other."""

    rings: Sequence[Floats]  # (N, 2) um each, in the part's frame
    bright: float = 0.8  # reflectance of the part
    dark: float = 0.1  # of what is around it
    dust: int = 0  # specks all over the picture, that take half of the light
    gradient: float = 0.0  # relative, of light across the picture
    halo: tuple[float, float] = (0.0, 1.0)  # share of all light, and its radius, px


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """Counts of light 0..1 are black + (white - black) light**gamma, cut to 0..top."""

    top: int = 255
    gain: float = 1.05
    gamma: float = 1.0
    black: float = 0.0  # counts of no light; below 0 it is cut off
    noise: Sequence[tuple[float, float]] = ((0.0, 1.5), (255.0, 1.5))  # level, sigma

    def counts(self, light: Floats, rng: np.random.Generator) -> npt.NDArray[np.uint16]:
        """Return the counts of light (rows, columns), share of full scale."""
        curve = np.clip(light * self.gain, 0, None) ** self.gamma
        level = self.black + (self.top - self.black) * curve
        at, sigma = np.array(self.noise).T
        noisy = level + rng.normal(size=light.shape) * np.interp(level, at, sigma)
        cut = np.clip(np.rint(noisy), 0, self.top)
        return np.asarray(cut, dtype=np.uint16)


_SPECK_PX = 1.5  # radius of a speck of dust


def picture(
    scene: Scene,
    pose: Pose,
    lens: Lens,
    camera: Camera,
    grid: Grid,
    rng: np.random.Generator,
) -> npt.NDArray[np.uint16]:
    """Return the counts of a part at a pose, (rows, columns)."""
    rings = [pose.apply(ring) for ring in scene.rings]
    share = coverage(rings, grid) if rings else np.zeros((1, 1))
    points = np.broadcast_to(
        scene.dark + (scene.bright - scene.dark) * share,
        (grid.rows * grid.finer, grid.columns * grid.finer),
    )
    light = grid.pixels(blurred(points, lens, grid))
    part, radius = scene.halo
    light = (1 - part) * light + part * gaussian_filter(light, radius)
    row, column = np.indices(light.shape)
    for _ in range(scene.dust):
        y, x = rng.uniform(0, grid.rows), rng.uniform(0, grid.columns)
        off2 = ((row - y) ** 2 + (column - x) ** 2) / _SPECK_PX**2
        light = light * (1 - 0.5 * np.exp(-off2 / 2))
    across = 1 + scene.gradient * ((column + 0.5) / grid.columns - 0.5)
    return camera.counts(light * across, rng)
