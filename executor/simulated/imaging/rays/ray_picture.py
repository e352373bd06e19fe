"""Radiance along the pupil's rays through points of a plane."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.executor.simulated.imaging.rays.beams import (
    Beams,
    Passage,
    beams_from,
    meet_faces,
    pass_down,
)
from microplan.executor.simulated.imaging.rays.face_light import FaceLight
from microplan.executor.simulated.imaging.rays.marching import (
    STAGE,
    FaceHits,
    RayFan,
    Reals32,
    Solids,
    fan_through,
    joined,
)
from microplan.executor.simulated.imaging.rays.regions import CUT, OPEN
from microplan.executor.simulated.imaging.rays.shading import MOST_RAYS

MOST_LIT = 1 << 20  # rays whose ends are lit at once

Chief = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, eq=False)
class RayPicture:
    """Rays of the camera through a scene; points are from the image's middle."""

    solids: Solids
    light: FaceLight
    slopes: FloatArray  # (count, 2), through the pupil
    spread: float  # of a beam, um per um of height
    chief: Chief  # slopes of the middle ray at points
    aside: FloatArray | None = None  # (count, 2) um past points of focus; None: 0

    def through(self, x: FloatArray, y: FloatArray, at_um: float) -> FloatArray:
        """Return mean radiance at points of a focal plane, (N,)."""
        found = self._seen(x, y, lambda fan: self._ends(self._beside(fan), at_um))
        return np.concatenate([light.mean(axis=1, dtype=float) for light in found])

    def in_plane(
        self, x: FloatArray, y: FloatArray, *, at_um: float, face: int, edge_um: float
    ) -> Reals32:
        """Return radiance at points of a plane in which there is a face, (N, count).

        Parameters
        ----------
        x, y : (N,) float arrays
            Points from the image's middle, um.
        at_um : float
            Height of the plane.
        face : int
            Body whose top face rays that come straight end on, STAGE, or OPEN: they
            go on below; CUT: they are in a body.
        edge_um : float
            Width of the ramps that edges in the plane are drawn as, where mirrored.
        """

        def ends(fan: RayFan) -> list[FaceHits]:
            down = self._down(fan, at_um, at_um)
            hits = down.hits + self.solids.end(down.bent, at_um, edge_um)
            if face == OPEN:
                hits += self._below(down.beams, at_um)
            elif face != CUT:
                hits.append(FaceHits(face, down.beams.rays))
            return hits

        return np.concatenate(list(self._seen(x, y, ends)))

    def _seen(
        self, x: FloatArray, y: FloatArray, ends: Callable[[RayFan], list[FaceHits]]
    ) -> Iterator[Reals32]:
        """Yield radiance at some points after the others, (points, count)."""
        many = max(1, MOST_LIT // len(self.slopes))
        for first in range(0, len(x), many):
            some = slice(first, first + many)
            hits, before = [], 0
            for fan in self._fans(x[some], y[some]):
                hits += [_owned(hit, before) for hit in ends(fan) if len(hit.rays)]
                before += len(fan)
            yield self._radiance(hits, before)

    def _down(self, fan: RayFan, meet_um: float, to_um: float) -> Passage:
        """Return what becomes of beams from the sky that meet in a plane above `to`."""
        sky_um = self.solids.sky_um
        start = beams_from(fan, meet_um - sky_um, self.spread)
        return pass_down(self.solids, start, (sky_um, to_um), meet_um, self.spread)

    def _beside(self, fan: RayFan) -> RayFan:
        """Return rays through points as a wavefront error lets them pass by."""
        if self.aside is None:
            return fan
        aside = self.aside.astype(np.float32)[np.arange(len(fan)) % len(self.slopes)]
        return replace(fan, x=fan.x + aside[:, 0], y=fan.y + aside[:, 1])

    def _ends(self, fan: RayFan, meet_um: float) -> list[FaceHits]:
        """Return where beams from the sky end."""
        solids = self.solids
        if meet_um <= solids.stage_um:
            return self._last(self._down(fan, meet_um, solids.stage_um))
        if meet_um >= solids.sky_um:
            start = beams_from(fan, meet_um - solids.sky_um, self.spread)
            span = (solids.sky_um, solids.stage_um)
            return self._last(pass_down(solids, start, span, meet_um, self.spread))
        above = self._down(fan, meet_um, meet_um)
        faces = meet_faces(solids, above.beams, meet_um)
        bent, more = solids.meet_faces(above.bent, meet_um)
        return [
            *above.hits, *faces, *more, *self._below(above.beams, meet_um, bent)
        ]  # fmt: skip

    def _below(
        self, beams: Beams, meet_um: float, bent: RayFan | None = None
    ) -> list[FaceHits]:
        """Return where beams end that go on below the plane in which they meet."""
        span = (meet_um, self.solids.stage_um)
        return self._last(
            pass_down(self.solids, beams, span, meet_um, self.spread, bent)
        )

    def _last(self, down: Passage) -> list[FaceHits]:
        """Return all hits of beams that have come down to the stage."""
        at_um = self.solids.stage_um
        faces = meet_faces(self.solids, down.beams, at_um)
        bent, more = self.solids.meet_faces(down.bent, at_um)
        stage = [FaceHits(STAGE, rays) for rays in (down.beams.rays, bent)]
        return [*down.hits, *faces, *more, *stage]

    def _radiance(self, hits: list[FaceHits], rays: int) -> Reals32:
        """Return what each of so many rays brings, (points, count)."""
        faces = sorted({hit.face for hit in hits})
        merged = [
            FaceHits(face, joined([hit.rays for hit in hits if hit.face == face]))
            for face in faces
        ]
        self.light.prepare(merged)
        total = np.zeros(rays)
        for hit in merged:
            light = self.light.radiance(hit)
            total += np.bincount(hit.rays.owner, weights=light, minlength=rays)
        return total.reshape(-1, len(self.slopes)).astype(np.float32)

    def _fans(self, x: FloatArray, y: FloatArray) -> Iterator[RayFan]:
        """Yield rays of all slopes through points, some points at once."""
        many = max(1, MOST_RAYS // len(self.slopes))
        for first in range(0, len(x), many):
            px, py = x[first : first + many], y[first : first + many]
            fan = fan_through(px, py, self.slopes)
            tilt_x, tilt_y = self.chief(px, py)
            if np.any(tilt_x) or np.any(tilt_y):
                fan.slope_x[:] += np.repeat(tilt_x, len(self.slopes)).astype(np.float32)
                fan.slope_y[:] += np.repeat(tilt_y, len(self.slopes)).astype(np.float32)
            yield fan


def _owned(hit: FaceHits, before: int) -> FaceHits:
    """Return hits of rays that come after so many others."""
    return FaceHits(hit.face, replace(hit.rays, owner=hit.rays.owner + before))
