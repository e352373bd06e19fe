"""How far edges in focus move in partly coherent light: all alike, and by contrast."""

from __future__ import annotations

from microplan.optics.coherence.degree import Coherence
from microplan.optics.coherence.edge_offsets import edge_offset_um
from microplan.optics.transfer.microscope import Microscope

MOST_OFFSET = 0.11  # wavelength / A, rounded up from the table's .108 at full contrast
DIFFERENT = 0.5  # of it by which edges of another contrast may move more or less


def dilation_um(
    coherence: Coherence | None, microscope: Microscope, contrast: float
) -> tuple[float, float]:
    """Return least and greatest displacement of edges in focus, into the bright side.

    Parameters
    ----------
    coherence : Coherence, optional
        None: incoherent light, whose edges stay.
    contrast : float
        Of the amplitudes at the edges, see
        `microplan.optics.coherence.edge_offsets.amplitude_contrast`.

    Returns
    -------
    (float, float)
        um, >= 0. Of a coherence that is not stated 0 to `MOST_OFFSET` wavelength / A,
        whatever the contrast.
    """
    if coherence is None:
        return (0.0, 0.0)
    airy_um = microscope.wavelength_um / microscope.aperture
    if not coherence.is_stated:
        return (0.0, MOST_OFFSET * airy_um)
    found = [edge_offset_um(s, microscope, contrast) for s in coherence.samples]
    return (min(found), max(found))


def differing_um(coherence: Coherence | None, microscope: Microscope) -> float:
    """Return how far edges of one contrast may move against those of another, um.

    Half of how far edges of full contrast move.
    """
    if coherence is None:
        return 0.0
    return DIFFERENT * dilation_um(coherence, microscope, 1.0)[1]
