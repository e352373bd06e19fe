"""Simulated workcell: its own world, contact model, camera, drivers.

In: `World` (schemas.files.world), a seed, names of faults. Out: `Station` for
executor.run, and a `Verdict` that no plan sees.
The type that passes: `Truth` (truth), `Cell` (cell).
May be touched here: the models, but never by what the compiler uses for the same
question: the cell is its judge, and shares only the renderer (optics).
Watched by: tests/executor/simulated/test_contact.py, test_keyed_contact.py,
tests/executor/whole_runs/test_fault_matrix.py.
"""
