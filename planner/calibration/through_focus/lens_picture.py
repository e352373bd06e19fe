"""What fits of a lens ask of a picture of something known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, Self

from microplan.arrays import BoolArray, FloatArray
from microplan.optics.transfer.microscope import Terms


@dataclass(frozen=True, slots=True, kw_only=True)
class TriedLens:
    """A lens that may have taken pictures, and how its focus reads."""

    aperture: float
    zero_um: float  # reading at which the part is in focus
    scale: float  # um of travel a um of reading
    terms: Terms = ()

    def defocus_um(self, reading_um: float) -> float:
        """Return the height of the plane in focus over the part, um."""
        return self.scale * (reading_um - self.zero_um)


class LensPicture(Protocol):
    """One picture, and the image of any lens there."""

    @property
    def z_um(self) -> float:
        """Return the focus reading."""
        ...

    @property
    def shown(self) -> FloatArray:
        """Return the light, (rows, columns), 0..1."""
        ...

    @property
    def used(self) -> BoolArray:
        """Return the pixels to fit, (rows, columns)."""
        ...

    @property
    def depth_um(self) -> float:
        """Return the depth of field by the stated aperture."""
        ...

    def image(self, lens: TriedLens) -> FloatArray:
        """Return the image that a lens makes, (rows, columns)."""
        ...

    def design(self, image: FloatArray) -> FloatArray:
        """Return what else changes an image (rows, columns), (N, K) of used pixels.

        Light first, then a shift to the right and down.
        """
        ...

    def moved(self, right_px: float, down_px: float) -> Self:
        """Return the picture with what it shows expected elsewhere."""
        ...

    def is_alike(self, other: Self) -> bool:
        """Return whether another's image changes as this one's does."""
        ...
