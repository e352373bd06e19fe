"""Microscope pictures of flat parts with known truth, from first principles.

In: outlines as polygons (x, y) um, a pose, lens and camera in the user's words.
Out: counts as a camera gives them.
Nothing of `microplan` is imported: own raster, own pupil, own camera.
"""
