"""Degree of coherence of a light: an interval of the condenser's relative aperture."""

from __future__ import annotations

from dataclasses import dataclass

MOST = 4.0  # aperture of the condenser over that of the objective
_FLAT = 0.5  # where full edges move most: `microplan.optics.coherence.edge_table`
_SAMPLES = 9  # of the interval: offsets have one flat maximum over it


@dataclass(frozen=True, slots=True, kw_only=True)
class Coherence:
    """Least and greatest aperture of the condenser over that of the objective."""

    least: float
    most: float
    is_stated: bool = True  # else it is what a kind of light allows

    def __post_init__(self) -> None:
        if not 0 <= self.least <= self.most <= MOST or self.most == 0:
            raise ValueError(
                f"coherence must be 0 <= least <= most <= {MOST:g} and not 0, got "
                f"{self.least}, {self.most}"
            )
        if self.is_stated and self.least == 0:
            raise ValueError("a stated coherence must be above 0")

    @property
    def worst(self) -> float:
        """Return the relative aperture whose edges move most."""
        return min(max(self.least, _FLAT), self.most)

    @property
    def samples(self) -> tuple[float, ...]:
        """Return relative apertures over the interval, all above 0."""
        low = max(self.least, 1e-3)
        step = (self.most - low) / (_SAMPLES - 1)
        found = {low + step * k for k in range(_SAMPLES)} | {self.worst}
        return tuple(sorted(found))

    def __str__(self) -> str:
        """Return how findings and ledgers write it."""
        if self.least == self.most:
            return f"{self.least:g}"
        return f"{self.least:g} to {self.most:g}"
