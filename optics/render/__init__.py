"""Rendering of a scene: outlines' spectra times OTF and pixel, sampled at pixels.

In: `Scene`, `Microscope`, focus, window, `Sampling`, from featuresel.look and planner.
Out: images (rows, columns) in shares of full scale, to optics.layers, featuresel.look
and planner; the cheapest `Fidelity` within an error budget.
The type that passes: `Scene` (scene), in; `Covered` (render), between layers.
May be touched here: tiles, transforms and their speed, within the errors `sampling`
and `fidelity` predict.
Watched by: tests/optics/render/test_render.py and test_fidelity.py.
"""
