"""Functions compiled to machine code when they are first called, types kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Return a function of arrays and numbers, compiled for their types.

    The code is kept beside the module for later processes; the same operations in the
    same order as in Python.
    """
    return cast(F, njit(cache=True, error_model="numpy")(function))
