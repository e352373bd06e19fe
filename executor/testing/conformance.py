"""Conformance of a driver: the checks of its role, run one by one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.loading import ROLES, check_role
from microplan.executor.testing.bench import Bench, Check, ConformanceError, must
from microplan.executor.testing.movers import AXES, JAWS, LENS
from microplan.executor.testing.others import CAMERA, CLOCK, LIGHT


@dataclass(frozen=True, slots=True)
class Result:
    """Result of one check: its name, and what is wrong; "" if nothing is."""

    check: str
    wrong: str


def checks(role: str) -> Mapping[str, Check]:
    """Return the checks of a role by name."""
    found = {
        "stage": AXES, "robot": AXES, "jaws": JAWS, "lens": LENS, "light": LIGHT,
        "camera": CAMERA, "clock": CLOCK,
    }  # fmt: skip
    if role not in found:
        raise ValueError(f"no role {role!r}, known: {', '.join(ROLES)}")
    return found[role]


def results(device: Any, role: str, bench: Bench) -> Iterator[Result]:
    """Yield one result a check; a device that lacks methods gets no further."""
    try:
        check_role(device, role, role)
    except ExecutorError as error:
        yield Result("has all methods", error.message)
        return
    for name, check in checks(role).items():
        try:
            check(device, bench)
        except ConformanceError as error:
            yield Result(name, str(error))
        else:
            yield Result(name, "")
        finally:
            if hasattr(device, "stop"):
                device.stop()


def failures(device: Any, role: str, bench: Bench) -> tuple[Result, ...]:
    """Return the checks that a driver fails."""
    return tuple(r for r in results(device, role, bench) if r.wrong)


def conforms(device: Any, role: str, bench: Bench) -> None:
    """Raise ConformanceError with all that is wrong with a driver; for a test."""
    wrong = [f"{r.check}: {r.wrong}" for r in failures(device, role, bench)]
    must(not wrong, "; ".join(wrong))
