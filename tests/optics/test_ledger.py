"""The ledger's predictions against measured errors."""

import numpy as np
import pytest

from optics.fidelity import choose
from optics.ledger import blend_error, ledger
from optics.sampling import BAND_ERROR, CUTS, band_cut, band_error
from optics.scene import Layer, Scene
from tests.optics.shapes import disc, microscope, rectangle


def test_the_band_error_falls_with_the_cut_and_rises_with_sharpness() -> None:
    optics = microscope()
    for z_um in (0.0, 5.0, 50.0):
        error = band_error("hopkins", optics, z_um)
        assert (np.diff(error) <= 0).all()
        cut = band_cut("hopkins", optics, z_um)
        assert error[np.searchsorted(CUTS, cut)] <= BAND_ERROR
    cuts = [band_cut("hopkins", optics, z) for z in (0.0, 5.0, 50.0, 250.0)]
    assert cuts == sorted(cuts, reverse=True)


def _scene(*layers: Layer) -> Scene:
    return Scene(layers=layers, background=0.1)


def _layer(name: str, z_um: float, x_um: float = 0.0) -> Layer:
    outline = rectangle(x_um, -50.0, x_um + 100.0, 50.0)
    return Layer(name=name, outline=outline, z_um=z_um, reflectance=0.5)


def test_blending_costs_most_where_edges_touch() -> None:
    optics = microscope()
    plate = _layer("plate", 0.0, -100.0)
    touching = blend_error(_scene(plate, _layer("top", 0.5)), optics, 0.0)
    apart = blend_error(_scene(plate, _layer("top", 0.5, 50.0)), optics, 0.0)
    level = blend_error(_scene(plate, _layer("top", 0.0)), optics, 0.0)
    blurred = blend_error(_scene(plate, _layer("top", 60.0)), optics, 30.0)
    assert touching[0] == pytest.approx(0.25, abs=0.03)
    assert touching[1].startswith("top over plate")
    assert apart[0] == 0.01
    assert level[0] == 0
    assert blurred[0] == 0.2


def test_the_ledger_names_every_effect_once_and_hides_none() -> None:
    scene = _scene(
        _layer("plate", -30.0),
        Layer(name="pin", outline=disc(20.0), z_um=0.0, reflectance=0.9),
    )
    fidelity = choose(scene, microscope(), focus_um=(0.0,), limit=0.01)
    rows = ledger(scene, microscope(), 0.0, fidelity)
    names = [row.effect for row in rows]
    assert len(set(names)) == len(names)
    by_name = {row.effect: row for row in rows}
    assert by_name["defocus law"].predicted_error == fidelity.predicted_error
    assert by_name["defocus law"].level == fidelity.model
    for refused in fidelity.refused:
        assert refused.model in by_name["defocus law"].reason
    assert by_name["band and tile"].predicted_error == fidelity.sampling_error
    for row in rows:
        assert row.predicted_error is not None or row.level == "not modelled"
        assert row.reason
    assert by_name["partial coherence"].level == "not modelled"
    assert by_name["side walls"].predicted_error is None
    offset = by_name["edge offset by coherence"]
    assert offset.unit == "um"
    assert offset.predicted_error == pytest.approx(0.154, abs=1e-3)


def test_an_empty_scene_has_a_ledger() -> None:
    fidelity = choose(_scene(), microscope(), focus_um=(0.0,), limit=0.01)
    assert ledger(_scene(), microscope(), 0.0, fidelity)[0].predicted_error == 0
