"""Lower bound of P(success): its parts, and what it leaves out."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class StepBound:
    """What a step's probability is at least."""

    step: str  # its id
    success_low: float  # at the bound's confidence, all steps together


@dataclass(frozen=True, slots=True, kw_only=True)
class BiasRow:
    """One side of the box of biases; sides add up linearly, never in quadrature."""

    step: str  # whose P it moves
    term: str  # what may be biased
    half_width_um: float  # to every side
    source: str  # where the number comes from


@dataclass(frozen=True, slots=True, kw_only=True)
class SuccessBound:
    """What P(success) is at least, by so many random trials of each look.

    success_low = mechanical_low - undetected_upper - outside, not below 0.
    """

    confidence: float  # one-sided, of the whole bound
    success_low: float  # of the whole run
    mechanical_low: float  # product of the steps', biases and sigmas at their ends
    undetected_upper: float  # that a look is accepted and wrong, in a run
    outside: float  # probabilities that are stated and not in P(success)
    terms: int  # measured numbers of which the bound takes an end
    trials: int  # random ones of the look that has the fewest
    undetected: int  # wrong answers accepted in all looks' random trials
    # the most that so many trials could show, none of them wrong
    reachable: float
    # of each look, that would show the goal if they found the same; None: none would
    trials_needed: int | None
    steps: tuple[StepBound, ...]  # those that look or may miss, in order
    biases: tuple[BiasRow, ...]  # the box
    left_out: tuple[str, ...]  # what neither P(success) nor the bound has
