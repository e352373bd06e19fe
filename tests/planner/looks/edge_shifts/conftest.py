"""A look at a disc, whose edges move alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.selection.random_parts import random_case
from microplan.featuresel.features.contour import with_contour
from microplan.featuresel.look.scenario import LookCase
from microplan.optics.render.scene import Illumination, Layer
from tests.optics.shapes import disc


@pytest.fixture
def post() -> LookCase:
    """Return a look at a bright disc of 22 um in focus over a dark ground."""
    case = random_case(np.random.default_rng(3))
    shape = disc(22.0)
    layer = Layer(name="part", outline=shape, z_um=0.0, reflectance=0.75)
    target = replace(
        case.target, kind="circle", symmetry=0, parameters={"radius_um": 22.0}
    )
    return replace(
        case,
        static=(),
        moving=(layer,),
        background=0.15,
        focus_um=0.0,
        light=Illumination(),
        target=with_contour(target, [shape]),
    )
