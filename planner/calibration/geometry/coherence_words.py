"""What an edge offset says of the light's coherence, in words: one light tells none."""

from __future__ import annotations

from collections.abc import Iterator

from microplan.optics.coherence.aberrated_edges import aberrated_offsets_um
from microplan.optics.coherence.degree import Coherence
from microplan.optics.coherence.edge_offsets import amplitude_contrast, edge_offset_um
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.calibration.calibrated_value import CalibratedValue

_TAKE = "photograph the part with the condenser at another aperture, or measure a width"


def coherence_words(
    offset: CalibratedValue | None,
    faces: tuple[float, float],
    scope: Microscope,
    light: Coherence | None,
) -> Iterator[str]:
    """Yield whether an edge offset is the part's own or coherence, if one is told.

    Parameters
    ----------
    offset : CalibratedValue, optional
        Of edges outwards from those drawn, um, by incoherent images in focus.
    faces : (part, background)
        Reflectances.
    scope : Microscope
        The lens, which the part is in focus of.
    light : Coherence, optional
        As the workcell has it; None: incoherent.
    """
    if offset is None or not isinstance(offset.value, float):
        return
    if light is None:
        return
    contrast = amplitude_contrast(*faces)

    def offset_um(coherence: float) -> float:
        added = aberrated_offsets_um(coherence, scope, contrast)
        return edge_offset_um(coherence, scope, contrast) + float(added.mean())

    sign = -1.0 if faces[0] > faces[1] else 1.0  # edges move into the bright side
    moved = sorted(sign * offset_um(each) for each in light.samples)
    if light.least == light.most:
        said = f"coherence {light} moves edges by {moved[0]:+.3f} um"
        own, (known,) = offset.value - moved[0], offset.sigma
        sigma = "" if known is None else f" +- {known:.2g}"
        yield f"{said}: the part's own edges lie {own:+.3f}{sigma} um outwards"
    else:
        said = f"{light} moves edges by {moved[0]:+.3f} to {moved[-1]:+.3f} um"
        yield f"no coherence: {said}, the part's own offset may be as large; {_TAKE}"
