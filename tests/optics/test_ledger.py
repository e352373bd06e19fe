"""The ledger's rows: every effect once, none hidden."""

from __future__ import annotations

from dataclasses import replace

import pytest

from microplan.optics.coherence.degree import Coherence
from microplan.optics.layers.layer_error import choose_layers
from microplan.optics.layers.shading import SHADED_ERROR
from microplan.optics.ledger import CONTRAST, NM, Imaged, LedgerRow, ledger
from microplan.optics.lens.lens import LensErrors
from microplan.optics.lens.lens_budget import predict
from microplan.optics.render.fidelity import choose
from microplan.optics.render.scene import Layer, Scene
from tests.optics.shapes import disc, microscope, rectangle

PLATE = Layer(
    name="plate",
    outline=rectangle(0.0, -50.0, 100.0, 50.0),
    z_um=-30.0,
    reflectance=0.5,
)
PIN = Layer(name="pin", outline=disc(20.0), z_um=0.0, reflectance=0.9)
LENS = LensErrors(distortion=0.01, lateral_sigma=0.002)


def imaged(*layers: Layer, coherence: float = 0.0) -> Imaged:
    scene = Scene(layers=layers, background=0.1)
    return Imaged(
        scene=scene,
        microscope=microscope(),
        focus_um=0.0,
        fidelity=choose(scene, microscope(), focus_um=(0.0,), limit=0.01),
        layering=choose_layers(scene, microscope(), focus_um=(0.0,), limit=0.01),
        coherence=Coherence(least=coherence, most=coherence) if coherence else None,
    )


def by_name(rows: tuple[LedgerRow, ...]) -> dict[str, LedgerRow]:
    assert len({row.effect for row in rows}) == len(rows)
    return {row.effect: row for row in rows}


def test_the_ledger_names_every_effect_once_and_hides_none() -> None:
    both = imaged(PLATE, PIN)
    points = [(20.0, 0.0), (-20.0, 0.0)]
    lens = predict(LENS, microscope(), points, defocus_um=2.0)
    rows = by_name(ledger(both, lens, shift_limit_nm=300.0))
    law, fidelity = rows["defocus law"], both.fidelity
    assert (law.predicted_error, law.level) == (
        fidelity.predicted_error,
        fidelity.model,
    )
    assert all(refused.model in law.reason for refused in fidelity.refused)
    assert rows["band and tile"].predicted_error == fidelity.sampling_error
    layers = rows["layers of different height"]
    assert layers.predicted_error == both.layering.predicted_error > 0
    assert {row.effect for row in lens} <= set(rows)
    # 0.002 of 2 um out of focus, per axis
    shift = rows["lateral shift with focus"]
    assert shift.predicted_error == pytest.approx(4.0)
    assert shift.unit == NM
    assert shift.limit == 300.0
    assert rows["side walls"].predicted_error is None
    for row in rows.values():
        assert row.predicted_error is not None or row.level == "not modelled"
        assert row.reason
        assert row.unit in (CONTRAST, NM)


def test_partial_coherence_is_charged_where_the_workcell_states_it() -> None:
    dark = by_name(ledger(imaged(PIN)))
    lit = by_name(ledger(imaged(PIN, coherence=0.5)))
    for name in ("partial coherence", "edge offset by coherence"):
        assert (dark[name].level, dark[name].predicted_error) == ("off", 0.0)
        assert lit[name].level == "charged"
    # an edge of full contrast moves .108 wavelength / A at coherence .5, 154 nm here;
    # this one's amplitudes are 1 and 1 / 3
    offset = lit["edge offset by coherence"].predicted_error
    assert offset is not None
    assert 20 < offset < 154
    assert (lit["partial coherence"].predicted_error or 0) > 0.02


def test_layers_far_from_focus_do_not_stop_the_ledger() -> None:
    far = replace(PLATE, z_um=-400.0)
    rows = by_name(ledger(imaged(far, PIN, coherence=0.5)))
    alone = by_name(ledger(imaged(PIN, coherence=0.5)))
    assert (
        rows["edge offset by coherence"].predicted_error
        == alone["edge offset by coherence"].predicted_error
    )


def test_an_empty_scene_has_a_ledger() -> None:
    rows = ledger(imaged(coherence=0.5))
    assert all(not row.predicted_error for row in rows)


def test_shade_is_modelled_left_out_or_unknown() -> None:
    effect = "shade of higher bodies"
    over = Layer(
        name="over", outline=rectangle(5, -50, 60, 50), z_um=40.0, reflectance=0.5
    )
    both = imaged(over, PIN)
    lamp = both.microscope.aperture
    rows = [
        by_name(ledger(each))[effect]
        for each in (
            both,
            replace(both, lamp_aperture=lamp),
            replace(both, lamp_aperture=lamp, is_shaded=True),
        )
    ]
    assert [row.level for row in rows] == ["not modelled", "left out", "modelled"]
    assert rows[0].predicted_error is None
    # the pin's face loses half of its light below the edge, where half is hidden too
    assert (rows[1].predicted_error or 0) == pytest.approx(0.9 / 4, rel=0.2)
    assert rows[2].predicted_error == SHADED_ERROR
