"""Workcell lines from pictures: what a camera is, with standard deviations.

In: PNG and TIFF files, series with a table of readings, a workcell file.
Out: the workcell with values, and what its block `calibrated` says of each.
The type that passes: `CalibrationSeries` of `CalibratedValue`s (calibrated_value).
May be touched here: statistics of counts, reading of series; which files are pictures
belongs to measure.
Watched by: tests/planner/calibration
"""
