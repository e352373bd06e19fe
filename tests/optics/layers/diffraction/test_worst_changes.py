"""The search for the largest diffraction against all points."""

from __future__ import annotations

import numpy as np

from microplan.optics.layers.diffraction.face_waves import wave_changes
from microplan.optics.layers.diffraction.worst_changes import SAFE, most_by_waves
from microplan.optics.layers.layer_edges import faces, meeting_points
from microplan.optics.layers.ray_probes import probes
from microplan.optics.outline.outline import place
from microplan.optics.render.scene import Layer, Scene
from microplan.optics.render.view_range import full
from tests.optics.shapes import disc, gear, microscope, rectangle


def test_half_of_the_largest_change_is_found_at_least() -> None:
    optics, focus_um = microscope(6.9, 120, 90), 0.0
    gap = place(rectangle(-60, -90, 12, 90), 0.0, 0.0, 0.3)
    layers = (
        Layer(name="gear", outline=gear(), z_um=0.0, reflectance=0.8),
        Layer(name="pin", outline=disc(14.0, (20.0, 5.0)), z_um=40.0, reflectance=0.6),
        Layer(name="jaw", outline=gap, z_um=130.0, reflectance=0.2),
    )
    scene = Scene(layers=layers, background=0.1)
    found = faces(scene, optics, focus_um, full(optics))
    at_um = meeting_points(found, optics, full(optics)).at_um
    rasters, light = probes(optics, found, at_um), np.ones((len(found), len(at_um)))
    most = most_by_waves(
        rasters, 0.1, optics, at_um, light=light,
        steps=[face.step for face in found], bound=np.ones(len(at_um)),
    )  # fmt: skip
    some = np.random.default_rng(3).choice(len(at_um), 120, replace=False)
    every = wave_changes(rasters, light[:, some], 0.1, optics, at_um[some])
    assert np.abs(every).max() <= most
    assert most / SAFE <= 0.25  # of unit contrast: two edges cost no more
