"""An image leaves out what neither shows in it nor shades what does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.optics.layers.shading import render_coaxial
from microplan.optics.render.scene import Layer, Scene, Window
from microplan.planner.task.task import Task
from microplan.planner.views.lens_errors import lamp_aperture, lamp_slope
from microplan.planner.views.light.layer_reach import lit, relevant
from microplan.planner.views.zooms import microscope_at
from tests.optics.shapes import rectangle
from tests.planner.examples import EXAMPLE, read


@pytest.fixture
def task() -> Task:
    return read(EXAMPLE / "task.yaml")


@pytest.mark.parametrize("away_um", [60.0, 150.0, 230.0, 260.0, 330.0])
def test_what_is_left_out_of_an_image_does_not_even_shade_it(
    task: Task, away_um: float
) -> None:
    """A roof beside a card in focus: its image ends sooner than its shade below."""
    scope = microscope_at(task.workcell, 6.9)
    side = 9
    window = Window(row=scope.height_px // 2 - 4, column=scope.width_px // 2 - 4,
                    rows=side, columns=side)  # fmt: skip
    card = Layer(name="card", outline=rectangle(-2.0, -2.0, 2.0, 2.0), z_um=0.0,
                 reflectance=0.7)  # fmt: skip
    roof = Layer(
        name="roof",
        outline=rectangle(away_um, -500.0, away_um + 1000.0, 500.0),
        z_um=0.0,
        reflectance=0.7,
    )
    scene = Scene(layers=(card, roof), background=0.6, background_z_um=-300.0)

    def shown(layers: tuple[Layer, ...]) -> FloatArray:
        return render_coaxial(
            replace(scene, layers=layers), scope, focus_um=0.0,
            lamp_aperture=lamp_aperture(task.workcell, scope), window=window,
        )  # fmt: skip

    kept = lit(scene, scope, 0.0, window, lamp_slope(task.workcell, scope))
    lost = float(np.abs(shown(kept) - shown(scene.layers)).max())
    assert lost < 1e-3
    by_image = relevant(scene.layers, scope, 0.0, window)
    if away_um == 150.0:  # what the image alone would miss
        assert roof not in by_image
        assert float(np.abs(shown(by_image) - shown(scene.layers)).max()) > 0.01
    assert (roof in kept) == (away_um < 300)
