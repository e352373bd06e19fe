"""What bodies out of focus hide and shade together: means of products, by rays.

In: faces on lattices of their own, points in the plane in focus; the light on faces
from optics.layers. Out: residuals of blending, and of products of shades.
The type that passes: `JointFace` (joint_faces), `JointResidual` (joint_occlusion).
May be touched here: rays, lattices and steps, within what `test_joint_occlusion.py`
allows against rays traced one by one.
Watched by: tests/optics/layers/joint/test_joint_occlusion.py.
"""
