"""Aperture, aberrations and focus: the edges of a known part through focus.

In: pictures with focus readings, a drawing, the workcell.
Out: what makes the compiler's images of the part's edges those of the pictures.
The type that passes: `FocusStep` (focus_step), `EdgePicture` (edge_picture).
May be touched here: profiles across edges; images come from the compiler's renderer.
Watched by: tests/planner/calibration/through_focus
"""
