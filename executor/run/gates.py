"""Gates of a measurement: limits of score, standard deviation, position, angle."""

from __future__ import annotations

import math
from dataclasses import dataclass

from microplan.featuresel.routines.fusion import SeenFeature
from microplan.schemas.plan import Measure
from microplan.schemas.pose import Pose


@dataclass(frozen=True, slots=True)
class GateValue:
    """Gate of a measurement: one value and its limit."""

    name: str
    code: str  # of an answer that does not pass
    value: float
    limit: float
    least: bool = False  # the limit is the least, not the most

    @property
    def passed(self) -> bool:
        """Return whether the value meets its limit; a nan does not."""
        return self.value >= self.limit if self.least else self.value <= self.limit

    @property
    def words(self) -> str:
        """Return the failure in words that follow the feature's name."""
        value, limit = f"{self.value:.3g}", f"{self.limit:.3g}"
        return {
            "score": f"scored {value}, needs {limit}",
            "spread": f"is known to {value} um by the routine's own estimate, at most "
            f"{limit} um",
            "shift": f"found {value} um from where it was expected, at most {limit} um",
            "turn": f"found turned {value} rad, at most {limit} rad",
        }[self.name]


def gates_of(
    measure: Measure, score: float, spread_um: float, seen: SeenFeature, expected: Pose
) -> tuple[GateValue, ...]:
    """Return the gates of an answer, in the order in which they are asked.

    Parameters
    ----------
    measure : Measure
        How the feature is measured.
    score, spread_um : float
        The routine's own.
    seen : SeenFeature
        Where it was found.
    expected : Pose
        Where the look's target is expected, world.
    """
    limits, turn_rad = measure.gates, None
    if seen.theta_rad is not None:
        turn_rad = abs(math.remainder(seen.theta_rad - expected.theta_rad, math.tau))
    x_um, y_um = expected.apply(*measure.offset_um)
    shift_um = math.hypot(seen.x_um - x_um, seen.y_um - y_um)
    asked = (
        ("score", "MP821", score, limits.min_score),
        ("spread", "MP825", spread_um, limits.max_spread_um),
        ("shift", "MP822", shift_um, limits.max_shift_um),
        ("turn", "MP823", turn_rad, limits.max_turn_rad),
    )
    return tuple(
        GateValue(name, code, value, limit, least=name == "score")
        for name, code, value, limit in asked
        if value is not None and limit is not None
    )
