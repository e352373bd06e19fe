"""What straight rays meet: looked up once, asked for often."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field

import numpy as np

from microplan.arrays import Float32Array
from microplan.optics.layers.solids.solid_bodies import SentLight
from microplan.optics.layers.solids.straight_rays import Rays, ThickBody, covers, hides


@dataclass(frozen=True, slots=True, kw_only=True)
class Sight:
    """Straight rays, with what was found of them."""

    rays: Rays
    soft: float  # width of a ray a um of height
    # with what the keys name by their identity, so that this stays theirs
    _held: dict[Hashable, tuple[object, Float32Array]] = field(default_factory=dict)

    def covers(self, body: ThickBody) -> Float32Array:
        """Return what a body's top covers of rays, (N, M) 0..1: points, slopes."""
        return self._kept(body, lambda: covers(body, self.rays, self.soft))

    def hides(self, body: ThickBody, to_um: float) -> Float32Array:
        """Return what a body hides of rays down to a height, (N, M) 0..1."""

        def found() -> Float32Array:
            top_um = body.top_um
            return hides(body, self.rays, self.soft, from_um=top_um, to_um=to_um)

        return self._kept((body, to_um), found)

    def sent(self, sends: SentLight, z_um: float) -> Float32Array:
        """Return shares sent to rays where they meet a height, (N, M) 0..1."""
        table = sends.table
        if table is None:
            return sends(*self.rays.at(z_um))
        share = self._kept(
            (id(table), z_um), lambda: table.at(*self.rays.at(z_um)), table
        )
        return np.float32(sends.dull) * share

    def _kept(
        self, key: Hashable, find: Callable[[], Float32Array], named: object = None
    ) -> Float32Array:
        """Return what was found before, or find it."""
        if key not in self._held:
            self._held[key] = named, find()
        return self._held[key][1]
