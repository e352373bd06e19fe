"""The laser-die example, from mask to die on its submount, on the simulated cell."""

from __future__ import annotations

import json
from pathlib import Path

import executor.cli
import planner.cli

TASK = Path(__file__).parents[2] / "examples" / "laser_die" / "task.yaml"
SEEDS = (1, 2, 3)
WITHIN_UM = 1.5  # what the example's last step asks for


def test_the_example_ends_with_the_die_beside_its_mark(tmp_path: Path) -> None:
    folder = tmp_path / "plan"
    call = ["compile", str(TASK), "-o", str(folder), "--preset", "fast", "--jobs", "2"]
    assert planner.cli.main(call) == 0
    plan = json.loads((folder / "plan.json").read_text(encoding="utf-8"))
    assert plan["status"] == "feasible"
    for seed in SEEDS:
        run = tmp_path / str(seed)
        words = ["--station", "sim", "--seed", str(seed), "--run-dir", str(run)]
        status = executor.cli.main([str(folder / "plan.json"), *words, "--no-frames"])
        summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
        verdict = summary["cell_verdict"]
        assert status == 0, summary["message"]
        assert verdict["success"], verdict
        assert verdict["offset_um"] < WITHIN_UM
        assert abs(verdict["height_um"]) < 1e-6
        assert summary["steps"][-1]["error_um"] < WITHIN_UM
