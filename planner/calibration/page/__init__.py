"""Page of a calibration: what was found, against what was stated, with its charts.

In: `CalibrationSeries` of a call.
Out: one HTML file that fetches and runs nothing.
The type that passes: `CalibrationSeries` (calibrated_value).
May be touched here: what is shown; what is found belongs to the series.
Watched by: tests/planner/calibration/page
"""
