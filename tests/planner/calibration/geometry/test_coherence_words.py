"""One light tells no coherence apart from edges that lie elsewhere, and says so."""

from __future__ import annotations

from dataclasses import replace

import pytest

from microplan.optics.coherence.aberrated_edges import aberrated_offsets_um
from microplan.optics.coherence.degree import Coherence
from microplan.optics.coherence.edge_offsets import amplitude_contrast, edge_offset_um
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.calibration.calibrated_value import (
    CalibratedValue,
    PictureSource,
    single,
)
from microplan.planner.calibration.estimates import BlockEstimate
from microplan.planner.calibration.geometry.coherence_words import coherence_words

FACES = 0.8, 0.1
SCOPE = Microscope(
    aperture=0.42, wavelength_um=0.6, medium_index=1.0, magnification=20.0,
    pitch_um=7.5, width_px=128, height_px=96,
)  # fmt: skip


def offset(um: float) -> CalibratedValue:
    found = BlockEstimate(value=um, sigma=0.002, method="edges", blocks=9)
    return single("edge_offset_um", found, PictureSource(pictures=9, sha256="0"))


def test_an_open_coherence_is_refused_and_what_tells_it_is_said() -> None:
    light = Coherence(least=0.0, most=1.0, is_stated=False)
    (said,) = coherence_words(offset(0.05), FACES, SCOPE, light)
    assert said.startswith("no coherence: 0 to 1 moves edges by ")
    assert "the condenser at another aperture" in said


def test_a_stated_coherence_is_taken_off_the_edges() -> None:
    """Edges of a bright part seem to lie inwards of it."""
    moved = edge_offset_um(0.5, SCOPE, amplitude_contrast(*FACES))
    (said,) = coherence_words(
        offset(0.05), FACES, SCOPE, Coherence(least=0.5, most=0.5)
    )
    own = float(said.partition("own edges lie ")[2].partition(" +-")[0])
    assert own == pytest.approx(0.05 + moved, abs=1e-3)


def test_what_a_wavefront_error_adds_is_taken_off_too() -> None:
    light = Coherence(least=0.2, most=0.2)
    found = []
    for terms in ((), ((11, 0.05),)):
        scope = replace(SCOPE, wavefront=terms)
        (said,) = coherence_words(offset(0.05), (0.8, 0.0), scope, light)
        found.append(float(said.partition("own edges lie ")[2].partition(" +-")[0]))
    added = aberrated_offsets_um(0.2, scope, 1.0)  # of all directions alike
    assert found[1] - found[0] == pytest.approx(added[0], abs=1.1e-3)
    assert added[0] > 0.01


def test_nothing_is_said_where_nothing_is_open() -> None:
    assert not list(coherence_words(offset(0.05), FACES, SCOPE, None))
    light = Coherence(least=0.5, most=0.5)
    assert not list(coherence_words(None, FACES, SCOPE, light))
    table = replace(offset(0.05), value=((0.0, 1.0),))
    assert not list(coherence_words(table, FACES, SCOPE, light))
