"""Why no chain of routines is good enough: the commonest reasons first, each once."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

from microplan.featuresel.trials.chains import Chain
from microplan.featuresel.trials.score import ChainScore

_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")
_UNSEEN = frozenset({
    "flat", "few_points", "few_rays", "misfit", "no_blob", "no_contrast", "no_edge",
    "no_fit", "no_notch", "no_peak", "no_teeth", "not_prepared", "too_dim",
})  # fmt: skip
_AWAY = frozenset({"border", "not_captured", "outside"})
_BLURRED = frozenset({"no_focus", "scale_off"})
_FAINT = (
    "most trials fail for want of contrast: a darker or brighter ground "
    "('reflectance'), other light, or another feature"
)
_FAR = (
    "most trials fail as it lies too far off: state a smaller sigma at its start if "
    "that is so, or locate something first that shows in a wider field"
)
_OTHER = (
    "most trials fail as scale or focus is off: state a smaller 'focus_sigma_um' or "
    "'magnification_sigma' if the station keeps them"
)
_HINTS = ((_UNSEEN, _FAINT), (_AWAY, _FAR), (_BLURRED, _OTHER))


def rejections(reasons: Sequence[tuple[Chain, str]]) -> str:
    """Return the reasons against chains, the commonest first.

    Reasons that differ in numbers alone count as one; the first chain's numbers stand
    for them. Equally common ones keep their order.

    Parameters
    ----------
    reasons : sequence of (chain, reason)
        As in `microplan.featuresel.selection.select.Selection`.
    """
    kinds: dict[str, list[tuple[Chain, str]]] = {}
    for chain, why in reasons:
        said = why.removeprefix("rejected: ")
        kinds.setdefault(_kind(said), []).append((chain, said))
    ordered = sorted(kinds.values(), key=lambda alike: -len(alike))  # stable
    return "; ".join(map(_told, ordered))


def commonest_hint(scores: Sequence[ChainScore], advice: str) -> str:
    """Return how to mend what most trials of all chains failed by, and `advice`.

    `advice` alone where trials fail by nothing that can be told.
    """
    codes: Counter[str] = Counter()
    for score in scores:
        codes.update(dict(score.failures))
    counts = [sum(codes[code] for code in kind) for kind, _ in _HINTS]
    answered = sum(score.success + score.silent for score in scores)
    if max(counts) <= answered:  # most trials had an answer: what it lacks is advised
        return advice
    hint = _HINTS[counts.index(max(counts))][1]
    return f"{advice}; {hint}" if advice else hint


def _kind(why: str) -> str:
    """Return a reason without its numbers, and without how far off answers were."""
    return _NUMBER.sub("#", re.sub(r"; worst .*", "", why))


def _told(alike: Sequence[tuple[Chain, str]]) -> str:
    """Return one reason, with the chain it is told of and how many share it."""
    chain, why = alike[0]
    more = f" and {len(alike) - 1} more" if len(alike) > 1 else ""
    return f"{' > '.join(chain)}{more}: {why}"
