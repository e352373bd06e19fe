"""How uneven the light is, by pictures of a field that has nothing in it.

In: pictures of a plane mirror or an empty stage, the camera's response.
Out: the light's gradient and what is left of a plane, with standard deviations.
The types that pass: `FieldLight` (field_light), `FieldStructure` (field_structure).
May be touched here: statistics over the field; what a gradient is belongs to optics.
Watched by: tests/planner/calibration/even_field
"""
