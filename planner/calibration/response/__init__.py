"""Response, black and white level of a camera, from one still scene in several lights.

In: `StillScene` of each light, with its reading.
Out: a power or a table, with standard deviations, or why pictures do not tell it.
The type that passes: `LightStep` (light_levels), `ResponseFit` (response_fit).
May be touched here: what is fitted to levels; how frames are added up belongs to
still_frames.
Watched by: tests/planner/calibration/response
"""
