"""Motion of devices: one door for all that moves, with collision checks.

In: `AxisMove` (schemas.plan), `Station` (executor.devices). Out: settled readings, or
a fault after which everything is stopped, to executor.run.
The type that passes: `Motion` (motion), `Beliefs` (beliefs), `SweptVolume`
(swept_volume).
May be touched here: nothing without a test that fails first: what is moved here may
break parts. Every motion goes through `Motion`.
Watched by: tests/executor/motion/test_motion.py, test_keep_out.py.
"""
