"""Solid bodies: outlines, distances to them, prisms at poses.

In: `WorldOutline` (schemas.files.world). Out: `MappedBody`, which rays look up.
The type that passes: `SolidScene` (solid_scene), `DistanceMap` (distance_map).
May be touched here: the maps' pitch; tests compare with closed forms.
Watched by: tests/executor/simulated/imaging/test_distance_map.py.
"""
