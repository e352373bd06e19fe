"""Are two plans the same in meaning: structure exact, numbers within tolerances.

Left out is what no other machine can reproduce to the byte: hashes of pixels that may
round the other way, journal keys that hold such hashes, and the version.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

# Keys whose values say nothing across machines, or are checked elsewhere.
SKIPPED = frozenset({"key", "image_sha256", "microplan"})
# A borderline trial may fall to the other side where sums are ordered otherwise; more
# than one of the trials that `fast` makes would be a change of meaning.
COUNTED = frozenset({"success", "silent"})
COUNT_SLACK = 1
# Numbers carry 6 digits; what trials average may move with one borderline trial.
REL = 1e-4
MEASURED = frozenset(
    {"sigma_um", "sigma_xy_um", "sigma_theta_rad", "bias_um", "worst_um", "min_score",
     "success_lower", "silent_upper", "tolerance_xy_um",
     "expected_cycles", "expected_s", "max_spread_um", "robustness", "resolution_um",
     "sigma_upper_um", "bias_x_um", "bias_y_um", "slope_per_um",
     "largest_um", "size_um", "halvings", "floor_s", "ratio_to_floor"}
)  # fmt: skip
# Chances of a task that mostly succeeds: 20 % of a sigma moves them by less.
CHANCES = frozenset({"success_probability", "halved_probability"})
CHANCE_ABS = 0.01
# Sentences in which only the numbers may differ.
WORDS = frozenset({"reason", "message", "advice", "source", "what"})
MEASURED_REL = 0.2  # of 24 trials; a routine that changed moves its sigma by more
MEASURED_ABS = 2e-3  # um or rad: biases are averages about 0
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?%?")


def differences(old: Any, new: Any, path: str = "plan") -> list[str]:
    """Return where two plans' data differ in meaning, in words."""
    return list(_differences(old, new, path, ""))


def _differences(old: Any, new: Any, path: str, key: str) -> Iterator[str]:
    """Yield the differences below `path`, whose innermost key is `key`."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        if list(old) != list(new):
            yield f"{path}: keys {list(old)} became {list(new)}"
            return
        for name in old:
            if name not in SKIPPED:
                yield from _differences(old[name], new[name], f"{path}.{name}", name)
    elif _is_list(old) and _is_list(new):
        if len(old) != len(new):
            yield f"{path}: {len(old)} entries became {len(new)}"
            return
        for index, (before, after) in enumerate(zip(old, new, strict=True)):
            yield from _differences(before, after, f"{path}[{index}]", key)
    elif not _same(old, new, key):
        yield f"{path}: {old!r} became {new!r}"


def _is_list(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _same(old: Any, new: Any, key: str) -> bool:
    """Return whether two plain values agree; numbers in texts are not looked at."""
    if type(old) is not type(new):
        return False
    if isinstance(old, str) and key in WORDS:
        return bool(_NUMBER.sub("#", old) == _NUMBER.sub("#", new))
    if isinstance(old, int) and key in COUNTED:
        return bool(abs(old - new) <= COUNT_SLACK)
    if not isinstance(old, float):
        return bool(old == new)
    if key in MEASURED:
        return math.isclose(old, new, rel_tol=MEASURED_REL, abs_tol=MEASURED_ABS)
    if key in CHANCES:
        return math.isclose(old, new, rel_tol=0, abs_tol=CHANCE_ABS)
    return math.isclose(old, new, rel_tol=REL, abs_tol=1e-6)
