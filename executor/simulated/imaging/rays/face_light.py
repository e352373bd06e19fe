"""Radiance of faces under coaxial light that other bodies shade."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from microplan.arrays import Box, FloatArray
from microplan.executor.simulated.imaging.imaging_view import ImagingView, RaySampling
from microplan.executor.simulated.imaging.rays.marching import (
    STAGE,
    FaceHits,
    RayFan,
    Reals32,
    Solids,
)
from microplan.executor.simulated.imaging.rays.pupil_rays import within_lamp
from microplan.executor.simulated.imaging.rays.shading import ShadeMap

FAR_UM = 60.0  # a plane farther out of focus is left to rays alone


class FaceLight:
    """What faces give back to rays of the camera; remembers how they are lit."""

    def __init__(
        self,
        solids: Solids,
        stage_reflectance: float,
        view: ImagingView,
        sampling: RaySampling,
        box: Box,  # that no ray leaves, from the image's middle
        sharp_um: float | None,  # height of the plane that is seen; None: far from all
    ) -> None:
        self._solids, self._view, self._sampling = solids, view, sampling
        self.stage_reflectance = stage_reflectance
        self._box, self._sharp_um = box, sharp_um
        self._maps: dict[float, ShadeMap] = {}  # by height

    def prepare(self, hits: Sequence[FaceHits]) -> None:
        """Compute how faces are lit where rays end on them."""
        if self._view.lamp_share == 0:
            return
        ends: dict[float, list[RayFan]] = {}
        for hit in hits:
            finish, at_um = 0.0, self._solids.stage_um
            if hit.face != STAGE:
                face = self._solids.bodies[hit.face]
                finish, at_um = face.body.finish, face.top_um
            if finish < 1 and len(hit.rays) and not self._open(at_um):
                ends.setdefault(at_um, []).append(hit.rays)
        for at_um, fans in ends.items():
            self._map(at_um).ask(fans)

    def radiance(self, hits: FaceHits) -> FloatArray:
        """Return what each ray brings back, (N,) shares of full scale."""
        rays, reflectance, finish = hits.rays, self.stage_reflectance, 0.0
        at_um = self._solids.stage_um
        if hits.face != STAGE:
            face = self._solids.bodies[hits.face]
            reflectance, finish = face.body.reflectance, face.body.finish
            at_um = face.top_um
        if self._view.lamp_share == 0:
            lit = np.ones(len(rays))
        else:
            lit = np.zeros(len(rays))
            if finish < 1:
                lit += (1 - finish) * self._irradiance(rays, at_um)
            if finish > 0:
                lit += finish * self._mirrored(rays, at_um)
        total: FloatArray = reflectance * lit * rays.weight
        return total

    def _irradiance(self, rays: RayFan, at_um: float) -> FloatArray | Reals32:
        """Return the share of the lamp's cone that reaches where rays end."""
        if self._open(at_um):
            return np.ones(len(rays))
        return self._map(at_um).at(rays.x, rays.y)

    def _open(self, at_um: float) -> bool:
        """Return whether nothing is above a height."""
        return all(body.top_um <= at_um for body in self._solids.bodies)

    def _map(self, at_um: float) -> ShadeMap:
        """Return the shading at a height, with as many rays as its use asks for."""
        if at_um not in self._maps:
            away_um = FAR_UM if self._sharp_um is None else abs(at_um - self._sharp_um)
            self._maps[at_um] = ShadeMap(
                self._solids, self._view, self._sampling, at_um, self._box, away_um
            )
        return self._maps[at_um]

    def _mirrored(self, rays: RayFan, at_um: float) -> FloatArray:
        """Return the light that comes along the rays that a mirror sends up."""
        view = self._view
        speed = np.hypot(rays.slope_x, rays.slope_y)
        lamp = within_lamp(view, speed)
        norm = min(view.lamp_share, 1.0) ** 2  # a mirror alone is as bright as a face
        up = RayFan(
            rays.x, rays.y, rays.slope_x, rays.slope_y,
            np.ones(len(rays), dtype=np.float32),
            np.arange(len(rays), dtype=np.int32),
        )  # fmt: skip
        sky = self._solids.ascend(up, at_um)
        reached = np.bincount(sky.owner, weights=sky.weight, minlength=len(rays))
        light: FloatArray = reached * lamp / norm
        return light
