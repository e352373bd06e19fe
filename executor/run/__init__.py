"""Execution of a plan: looks, probes, servo alignment, verification, resumption.

In: `Rig`: plan, station, beliefs, logs. Out: `RunResult` (executor.record.outcome), to
executor.cli.
The type that passes: `Rig` (run_context), `TargetSighting` (measure_target).
May be touched here: messages; an order of motions only with its journal lines, as a
resumed run repeats or skips them by name.
Watched by: tests/executor/run/test_servo.py, tests/executor/whole_runs.
"""
