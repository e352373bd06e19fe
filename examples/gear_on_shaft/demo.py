"""Compile the gear-on-shaft task, run it on the simulated cell, show the pictures.

Run from the repository's root: python examples/gear_on_shaft/demo.py --out build/demo
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

import microplan.executor.cli.main
import microplan.planner.cli.main

HERE = Path(__file__).parent
COLUMNS = 4  # of the contact sheet
WAIT = (
    "this takes some minutes the first time, seconds after that; nothing more is said "
    "before it is done where the output is no terminal"
)
SHRINK = 0.6  # of the frames on it

Picture = npt.NDArray[np.uint8]


def main() -> int:
    """Return 0 if the gear sits on the post, else the exit status of what failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for everything")
    parser.add_argument("--preset", default="balanced", help="fast is quicker")
    parser.add_argument("--seed", default="1", help="of the simulated cell")
    call = parser.parse_args()
    plan, run = call.out / "plan", call.out / "run"
    task = str(HERE / "task.yaml")
    print(f"compiling {task} (preset {call.preset}, 2 jobs) ...", flush=True)
    print(WAIT, flush=True)
    began_s = time.monotonic()
    options = ["-o", str(plan), "--jobs", "2", "--preset", call.preset, "--report"]
    status = microplan.planner.cli.main.main(["compile", task, *options])
    if status:
        return status
    print(f"compiled in {time.monotonic() - began_s:.0f} s", flush=True)
    print("\nrunning the plan on the simulated cell ... (half a minute)", flush=True)
    print("what happened beside what the plan predicted:", flush=True)
    # whole frames for the sheet: the solid camera takes minutes for them
    station = ["--station", "sim", "--camera", "quick"]
    station += ["--seed", call.seed, "--run-dir", str(run)]
    status = microplan.executor.cli.main.main([str(plan / "plan.json"), *station])
    if not (run / "summary.json").is_file():
        return status
    sheet = call.out / "steps.png"
    cv2.imwrite(str(sheet), contact_sheet(run / "frames"))
    print(closing_lines(plan, run, sheet))
    return status


def closing_lines(plan: Path, run: Path, sheet: Path) -> str:
    """Return what came of it, and where to look."""
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    verify = summary["steps"][-1]
    if verify["error_um"] is None:
        return f"\nthe run stopped: {summary['message']}\nframes: {run / 'frames'}"
    seen = "seated" if summary["done"] else "NOT seated"
    truth = summary["cell_verdict"]
    verdict = (
        f"the gear is {seen}: offset {verify['error_um']:.2f} um as measured, "
        f"{truth['offset_um']:.2f} um in truth (simulated), "
        f"limit {verify['limit_um']:g} um"
    )
    return "\n".join(
        [
            "",
            verdict,
            f"what the compiler expected to see  {plan / 'images'}",
            f"what the simulated camera saw      {run / 'frames'}",
            f"every step on one sheet            {sheet}",
            f"what the plan says, to read        {plan / 'report.html'}",
            f"what the run showed, to read       {run / 'report.html'}",
        ]
    )


def contact_sheet(frames: Path) -> Picture:
    """Return the last frame of every step, and of every look of it, named.

    What is out of focus in a frame is blurred, so the name tells the height in focus.
    """
    rows = map(json.loads, (frames / "index.jsonl").read_text("utf-8").splitlines())
    last = {(r["step"], r["look"]): r for r in rows if r["shows"] is None}
    taken = {step for step, look in last if look}  # frames of these are of looks
    tiles = [
        _tile(frames.parent / row["file"], f"focus {row['focus_um']:.0f} um")
        for (step, look), row in last.items()
        if look or step not in taken
    ]
    while len(tiles) % COLUMNS:
        tiles.append(np.zeros_like(tiles[0]))
    rows = [np.hstack(tiles[i : i + COLUMNS]) for i in range(0, len(tiles), COLUMNS)]
    sheet: Picture = np.vstack(rows)
    return sheet


def _tile(path: Path, more: str) -> Picture:
    """Return one frame, smaller, with the step's name under its left corner."""
    step = path.stem.rpartition("_")[0].replace("_", " ", 1)
    frame = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if frame is None:
        raise OSError(f"{path} is no picture")
    small = cv2.resize(frame, None, fx=SHRINK, fy=SHRINK, interpolation=cv2.INTER_AREA)
    framed = cv2.copyMakeBorder(small, 0, 22, 1, 1, cv2.BORDER_CONSTANT, value=0)
    words, at = f"{step}, {more}", (6, framed.shape[0] - 6)
    cv2.putText(framed, words, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 255, 1, cv2.LINE_AA)
    return framed.astype(np.uint8)


if __name__ == "__main__":
    raise SystemExit(main())
