"""What the simulated camera shows: solid bodies by rays and waves, or quick pictures.

In: `Truth`, `SimLens`. Out: shares of full scale, counts.
The type that passes: `Pictures` (simulated.camera), which both fulfil.
May be touched here: both; but `solid_pictures` imports nothing that the compiler
renders with. `quick_pictures`, the default, shares the compiler's renderer: a mistake
of that stands in both, so what a run shows with it judges no image.
Watched by: tests/executor/simulated/cameras/test_solid_pictures.py.
"""
