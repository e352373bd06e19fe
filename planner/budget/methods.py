"""Servo down the bore, or look once and move: which, and why."""

from __future__ import annotations

from collections.abc import Sequence

from microplan.optics.outline.tolerant_order import least
from microplan.schemas.page.figures import chance
from microplan.schemas.plan.verdicts import MethodChoice, MethodOption

# Chances that differ by less are equal: the quicker way is taken.
SAME_CHANCE = 1e-6


def choose(
    options: Sequence[MethodOption], goal: float, where: str = ""
) -> MethodChoice:
    """Return the quickest way that meets `goal`, else the likeliest.

    Parameters
    ----------
    options : sequence of MethodOption
        At least one; without chances (no insertion follows) the servo is taken, which
        alone looks again whether it is inside the tolerance.
    goal : float
        The insertion's share of the task's goal.
    where : str
        Named in the reason: the insertion.

    Raises
    ------
    ValueError
        If there is nothing to choose from.
    """
    if not options:
        raise ValueError("a choice needs at least one option")
    known = [(o.success_probability, o) for o in options]
    chances = [(chance, o) for chance, o in known if chance is not None]
    if len(chances) < len(options):
        servo = next((o for o in options if o.method == "servo"), options[0])
        reason = "no insertion follows; a servo alone sees that it is within tolerance"
        return _chosen(servo, options, reason)
    enough = [o for chance, o in chances if chance >= goal]
    if enough:
        best = _quickest(enough)
        said = "meets" if len(enough) == 1 else "is the quickest to meet"
        return _chosen(
            best, options, f"{said} {goal:.4g} at {where}: {_words(options)}"
        )
    top = max(chance for chance, _ in chances)
    likely = [o for chance, o in chances if chance >= top - SAME_CHANCE]
    best = _quickest(likely)
    reason = f"comes nearest to {goal:.4g} at {where}: {_words(options)}"
    return _chosen(best, options, reason)


def _chosen(
    option: MethodOption, options: Sequence[MethodOption], reason: str
) -> MethodChoice:
    return MethodChoice(
        asked="auto", method=option.method, reason=reason, options=tuple(options)
    )


def _quickest(options: Sequence[MethodOption]) -> MethodOption:
    """Return the quickest way, the first by name of those as quick."""
    return least(sorted(options, key=lambda o: o.method), lambda o: o.expected_s)


def _words(options: Sequence[MethodOption]) -> str:
    """Return every option with its chance and time."""
    return ", ".join(
        f"{o.method} P {chance(o.success_probability)} in {o.expected_s:.2g} s"
        for o in options
    )
