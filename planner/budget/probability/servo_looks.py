"""How many looks a servo takes until one is inside its tolerance."""

from __future__ import annotations

import math
from dataclasses import dataclass

MOST_LOOKS = 10_000  # after which the rest is taken as alike
_SETTLED = 1e-12  # change of a chance from look to look


@dataclass(frozen=True, slots=True, kw_only=True)
class Loop:
    """A servo in two axes alike; spreads are one sigma per axis."""

    gain: float
    move_um: float  # of where axes land about their reading
    look_um: float  # of what a look says
    start_um: float  # of the first look's true error, its landing among it
    within_um: float  # distance at which a look ends it


def expected_looks(loop: Loop) -> float:
    """Return how many looks a servo takes on average, inf if none is ever inside.

    A look sees m = a + w: what the readings are off by, a, and what is new each time,
    w, the landing and the look's own error. Outside the tolerance T the readings go by
    -g m, so that a+ = a - g m. With variances A and W per axis, M = A + W, a look ends
    it with 1 - exp(-T**2 / (2 M)). What goes on has E m**2 = M + T**2 / 2 per axis, and
    of it a is A / M m give or take A W / M; hence

        A+ = (A / M - g)**2 (M + T**2 / 2) + A W / M.

    What goes on is taken as normal again, which errs by up to 5 % of the looks at gains
    up to 1, the largest a plan has, and by 8 % at 1.4.
    """
    new = loop.move_um**2 + loop.look_um**2
    off = max(loop.start_um**2 - loop.move_um**2, 0.0)
    square = loop.within_um**2
    looks, going, before = 0.0, 1.0, -1.0
    for _ in range(MOST_LOOKS):
        seen = off + new
        if seen <= 0:
            return looks + going
        ends = -math.expm1(-square / (2 * seen))
        if abs(ends - before) <= _SETTLED * ends:
            break
        looks, going, before = looks + going, going * (1 - ends), ends
        if going <= 0:
            return looks
        share = off / seen
        off = (share - loop.gain) ** 2 * (seen + square / 2) + share * new
    return looks + going / ends if ends > 0 else math.inf
