"""Pitch, skew, distortion, stage axes, light: a known part at several places.

In: pictures with stage readings, a drawing, the workcell.
Out: how image, drawing and stage scale against each other, with standard deviations.
The type that passes: `PartPlace` (part_places), `StageFit` (stage_fit).
May be touched here: what is fitted to places; finding a part in a picture belongs to
measure.
Watched by: tests/planner/calibration/geometry
"""
