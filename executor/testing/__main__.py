"""The command `python -m microplan.executor.testing`: check a driver's role."""

from __future__ import annotations

import argparse
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from microplan.executor.devices.errors import ExecutorError
from microplan.executor.devices.loading import ROLES, build, load
from microplan.executor.testing.bench import Bench
from microplan.executor.testing.conformance import results
from microplan.schemas.page.console import say, tell


def main(argv: Sequence[str] | None = None) -> int:
    """Return 0 if the driver does what it must, 1 if not, 2 if it cannot be made."""
    parser = argparse.ArgumentParser(
        prog="python -m microplan.executor.testing",
        description="Check a driver. It moves: by the steps of --step, up and back.",
    )
    parser.add_argument("driver", help="an entry point, or module:attribute")
    parser.add_argument("--role", required=True, choices=list(ROLES))
    parser.add_argument("--part", help="what of the driver to test, if it is a hub")
    for name, what in (
        ("option", "of the driver, e.g. port='COM3'"),
        ("step", "a safe step, e.g. x_um=20"),
        ("beyond", "a target outside the limits, e.g. x_um=1e6"),
    ):
        parser.add_argument(
            f"--{name}", action="append", default=[], metavar="KEY=VALUE", help=what
        )
    call = parser.parse_args(argv)
    try:
        options = _pairs(call.option)
        made = build(load(call.driver, "driver"), "driver", options)
    except (ExecutorError, tomllib.TOMLDecodeError) as error:
        tell(f"error: {error}")
        return 2
    parts = [role for role in ROLES if getattr(made, role, None) is not None]
    if call.part and not hasattr(made, call.part):
        known = ", ".join(parts) or "none"
        tell(f"error: --part: {call.driver} has no {call.part!r}, parts: {known}")
        return 2
    device = getattr(made, call.part) if call.part else made
    bench = Bench(beyond=_pairs(call.beyond))
    bench = replace(bench, step={**bench.step, **_pairs(call.step)})
    if hasattr(made, "clock"):  # a hub has its own time
        bench = replace(bench, clock=made.clock)
    wrong = 0
    for result in results(device, call.role, bench):
        say(f"{'FAILED' if result.wrong else 'ok':6}  {result.check}  {result.wrong}")
        wrong += bool(result.wrong)
    if wrong and parts and not call.part:
        tell(f"{call.driver} is a hub: name what to test by --part: {', '.join(parts)}")
    return 1 if wrong else 0


def _pairs(words: Sequence[str]) -> dict[str, Any]:
    """Return options written as in TOML."""
    return tomllib.loads("\n".join(words))


if __name__ == "__main__":
    sys.exit(main())
