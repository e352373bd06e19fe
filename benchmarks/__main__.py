"""Measure and print: python -m benchmarks [NAME...] [--seeds 100:300] [--jobs 2]."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path

# One thread each, so that figures of one run compare; set before numpy is loaded.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from benchmarks.catalogue import BENCHMARKS  # noqa: E402 - see above
from benchmarks.figures import (  # noqa: E402 - see above
    Figure,
    Options,
    run,
    select,
    write,
)
from microplan.executor.simulated.cameras.kinds import CAMERAS  # noqa: E402 - see above

RESULTS = Path(__file__).with_name("results.json")


def main(argv: Sequence[str] | None = None) -> int:
    """Return 0 after measuring, 2 if the call is at fault."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks")
    parser.add_argument("names", nargs="*", metavar="NAME", help="figures; default all")
    parser.add_argument("--seeds", type=_seeds, default=Options().seeds)
    parser.add_argument("--jobs", type=int, default=Options().jobs)
    parser.add_argument("--camera", choices=CAMERAS, default=Options().camera)
    parser.add_argument("--plan", type=Path, help="plan.json; default: compile it")
    parser.add_argument("--out", type=Path, default=RESULTS)
    call = parser.parse_args(argv)
    try:
        chosen = select(BENCHMARKS, call.names)
    except ValueError as error:
        parser.error(str(error))
    figures: list[Figure] = []
    options = Options(
        seeds=call.seeds, jobs=call.jobs, plan=call.plan, camera=call.camera
    )
    for figure in run(chosen, options):
        print(json.dumps(figure.form()), flush=True)
        figures.append(figure)
    write(figures, call.out)
    return 0


def _seeds(text: str) -> range:
    """Return FIRST:END as a range."""
    first, _, end = text.partition(":")
    found = range(int(first), int(end))
    if not found or found.start < 0:
        raise ValueError("seeds are FIRST:END with 0 <= FIRST < END")
    return found


if __name__ == "__main__":
    sys.exit(main())
