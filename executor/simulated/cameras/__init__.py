"""What the simulated camera shows: solid bodies by rays and waves, or quick pictures.

In: `Truth`, `SimLens`. Out: shares of full scale, counts.
The type that passes: `Pictures` (simulated.camera), which both fulfil.
May be touched here: both; but `solid_pictures` imports nothing that the compiler
renders with, and nobody judges an image by `quick_pictures`.
Watched by: tests/executor/simulated/cameras/test_solid_pictures.py.
"""
