"""Workcell lines from pictures: what a camera is, measured without a model of images.

In: PNG and TIFF files of one still scene, a workcell file.
Out: the workcell with `camera.noise_table` and what `calibrated` says of it.
The type that passes: `StillScene` (still_frames), `NoiseRow` (photon_transfer).
May be touched here: statistics of counts; which files are read belongs to measure.
Watched by: tests/planner/calibration
"""
