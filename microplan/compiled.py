"""Functions compiled to machine code when they are first called, types kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Return a function of arrays and numbers, compiled for their types.

    The code is kept beside the module, or in the user's cache, for later processes.
    Numbers of other modules that it uses must come as arguments: kept code does not
    notice that they change.
    """
    try:
        made = njit(cache=True, error_model="numpy")(function)
    except RuntimeError:  # no folder to keep it in can be written
        made = njit(error_model="numpy")(function)
    return cast(F, made)
