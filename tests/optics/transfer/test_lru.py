"""Results held within some bytes: the same values, the oldest forgotten first."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from microplan.optics.render.render import cover
from microplan.optics.render.scene import Layer
from microplan.optics.render.spectrum import Tile, spectrum
from microplan.optics.transfer.lru import Recent
from tests.optics.shapes import gear, microscope


def test_what_was_asked_for_longest_ago_is_forgotten() -> None:
    made: list[str] = []

    def make(text: str) -> str:
        made.append(text)
        return text

    recent: Recent[str] = Recent(5, len)
    for text in ("aa", "bb", "aa", "cc", "aa", "bb"):
        assert recent.get(text, partial(make, text)) == text
    assert made == ["aa", "bb", "cc", "bb"]
    for _ in range(2):  # has no room at all, and takes none
        assert recent.get("large", partial(make, "six by")) == "six by"
    assert recent.get("aa", partial(make, "lost")) == "aa"


def test_spectra_and_blurred_layers_are_given_again_but_not_to_change() -> None:
    tile = Tile(left_um=-70.0, bottom_um=-70.0, width_um=140.0, height_um=140.0)
    first, again = (spectrum(gear(), tile, 0.3) for _ in range(2))
    assert first is again
    assert spectrum(gear(), tile, 0.3, single=True).values.dtype == np.complex64
    cut = spectrum(gear(), tile, 0.3, box=(-20.0, -70.0, 70.0, 70.0))
    assert not np.array_equal(cut.values, first.values)
    layer = Layer(name="gear", outline=gear(), z_um=3.0, reflectance=0.5)
    (one,) = cover([layer], microscope(6.9, 90, 90), focus_um=0.0)
    (two,) = cover([layer], microscope(6.9, 90, 90), focus_um=0.0)
    (other,) = cover([layer], microscope(6.9, 90, 90), focus_um=1.0)
    assert one is two
    assert not np.array_equal(one.coverage, other.coverage)
    for array in (first.values, one.coverage):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1.0
