"""Light of a workcell in scenes: what layers send in it, what keeps it off a target.

In: layers of bodies with their true reflectance (planner.views.scenes), `LightSpec`.
Out: layers as the light shows them, level of the bright field, the ring's lamp, to
planner.views and planner.looks; finding MP407.
The type that passes: `Layer` (optics.render.scene).
May be touched here: what a face sends in each kind of light, with docs/model.md.
Watched by: tests/planner/views/light/test_lit_layers.py, test_layer_reach.py.
"""
