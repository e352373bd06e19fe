"""Rays through solid bodies: beams of the pupil, mirrored rays, light on faces.

In: `MappedBody` (solids), `ImagingView`. Out: radiance along rays (ray_picture).
The type that passes: `RayFan` (marching), `Beams` (beams).
May be touched here: steps and samples: tests compare with closed forms.
Watched by: tests/executor/simulated/imaging/test_beams.py.
"""
