"""Many spoilt and random inputs.

`python -m benchmarks.robustness.fuzz [TARGET...] --examples N` tries them.

Each finding is printed smallest first, as hypothesis shrank it, and belongs into a test
of its own.
"""

from __future__ import annotations

import argparse
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from typing import Any

from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from tests.planner.drawings.dxf_text import binary
from tests.planner.source import fuzzing

_DXF = [
    *(text.encode() for text in fuzzing.DXF_TEXTS),
    *(
        binary(text, short=short)
        for text in fuzzing.DXF_TEXTS[:3]
        for short in (True, False)
    ),
]
TARGETS: dict[str, tuple[SearchStrategy[Any], Callable[[Any], None]]] = {
    "dxf-bytes": (fuzzing.spoilt_bytes(st.sampled_from(_DXF)), fuzzing.judge_dxf),
    "dxf-tags": (fuzzing.spoilt_dxf(), fuzzing.judge_dxf),
    "dxf-random": (fuzzing.random_dxf(), fuzzing.judge_dxf),
    "gds-bytes": (
        fuzzing.spoilt_bytes(st.sampled_from(fuzzing.GDS_FILES)), fuzzing.judge_gds,
    ),
    "gds-records": (fuzzing.spoilt_gds(), fuzzing.judge_gds),
    "gds-random": (fuzzing.random_gds(), fuzzing.judge_gds),
    "yaml": (fuzzing.spoilt_yaml(), lambda spoilt: fuzzing.judge_task(*spoilt)),
}  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Return 0 if nothing was found, 1 if something was."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=", ".join(TARGETS))
    parser.add_argument("--examples", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    call = parser.parse_args(argv)
    unknown = set(call.targets) - set(TARGETS)
    if unknown:
        parser.error(f"no target {sorted(unknown)}, known: {', '.join(TARGETS)}")
    bad = [
        name
        for name in call.targets or TARGETS
        if not tried(name, call.examples, call.seed)
    ]
    return int(bool(bad))


def tried(name: str, examples: int, root: int) -> bool:
    """Return whether a target met nothing wrong; print what it met."""
    inputs, judge = TARGETS[name]

    @seed(root)
    @settings(
        max_examples=examples, deadline=None, database=None,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(given_=inputs)
    def run(given_: object) -> None:
        judge(given_)

    started = time.process_time()
    try:
        run()
    except Exception:  # noqa: BLE001 - whatever the readers let through
        print(f"{name}: found\n{traceback.format_exc()}", flush=True)
        return False
    taken = time.process_time() - started
    print(f"{name}: {examples} inputs, {taken:.0f} s of CPU, nothing", flush=True)
    return True


if __name__ == "__main__":
    sys.exit(main())
