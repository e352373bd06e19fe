"""Affine maps of the plane, points as complex numbers x + i y."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Affine:
    """A map of the plane, z -> a z + b conj(z) + t; a similarity if a or b is 0."""

    a: complex = 1 + 0j
    b: complex = 0j
    t: complex = 0j

    @classmethod
    def scale(cls, x: float, y: float) -> Affine:
        """Return the map that scales along the axes."""
        return cls(complex((x + y) / 2), complex((x - y) / 2))

    def point(self, z: complex) -> complex:
        """Return the image of a point."""
        return self.vector(z) + self.t

    def vector(self, z: complex) -> complex:
        """Return the image of a difference of points."""
        return self.a * z + self.b * z.conjugate()

    def of(self, inner: Affine) -> Affine:
        """Return the map that applies `inner` first."""
        a = self.a * inner.a + self.b * inner.b.conjugate()
        b = self.a * inner.b + self.b * inner.a.conjugate()
        return Affine(a, b, self.point(inner.t))

    @property
    def stretch(self) -> float:
        """Return the largest factor by which lengths grow."""
        return abs(self.a) + abs(self.b)

    @property
    def matrix(self) -> tuple[float, float, float, float]:
        """Return m of x, y -> m0 x + m1 y + t.real, m2 x + m3 y + t.imag."""
        a, b = self.a, self.b
        return a.real + b.real, b.imag - a.imag, a.imag + b.imag, a.real - b.real
