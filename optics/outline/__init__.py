"""Outlines of planar parts: segments and arcs in closed rings, um.

In: rings from planner.drawings, numbers of offsets and maps. Out: outlines, clipped
edges and their Fourier integrals, to optics.render, optics.layers and planner.
The type that passes: `Outline` (`microplan.optics.outline.outline`).
May be touched here: how edges are clipped, offset, warped and counted; not that outer
rings run counter-clockwise, on which all areas rest.
Watched by: tests/optics/outline/test_offset.py and test_fourier_integral.py.
"""
