"""How a run and its steps ended."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class StepResult:
    """What one step did; None where it does not apply."""

    id: str
    verb: str
    code: str | None  # why it failed; None: done
    message: str
    time_s: float
    expected_s: float | None
    cycles: int | None
    expected_cycles: float | None
    error_um: float | None  # align: last error; verify: offset
    limit_um: float | None
    spread_um: float | None  # the routine's own sigma
    expected_sigma_um: float | None  # from the trials
    height_um: float | None
    turn_rad: float | None = None  # verify: against the seat, if it was asked for


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """How the run ended; `code` is None if everything was done and verified."""

    code: str | None
    message: str
    step: str | None  # where it failed
    steps: tuple[StepResult, ...]
    time_s: float

    @property
    def done(self) -> bool:
        """Return whether the executor vouches for the result."""
        return self.code is None
