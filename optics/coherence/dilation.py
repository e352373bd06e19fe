"""How far edges in focus move in partly coherent light: all alike, and otherwise."""

from __future__ import annotations

import numpy as np

from microplan.arrays import FloatArray
from microplan.optics.coherence.aberrated_edges import aberrated_offsets_um
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
        um, below 0 only by a wavefront error: of edges all round a disc the middle, see
        `uneven_um`. Of a coherence that is not stated 0 to `MOST_OFFSET` wavelength /
        A, whatever the contrast, and what a wavefront error adds.
    """
    if coherence is None:
        return (0.0, 0.0)
    airy_um = microscope.wavelength_um / microscope.aperture
    added = _added_um(coherence, microscope, contrast if coherence.is_stated else 1.0)
    middle = (added.min(axis=1) + added.max(axis=1)) / 2
    if not coherence.is_stated:
        low, high = float(middle.min()), float(middle.max())
        return (min(low, 0.0), MOST_OFFSET * airy_um + max(high, 0.0))
    plain = [edge_offset_um(s, microscope, contrast) for s in coherence.samples]
    found = np.array(plain) + middle
    return (float(found.min()), float(found.max()))


def uneven_um(
    coherence: Coherence | None, microscope: Microscope, contrast: float
) -> float:
    """Return by how much edges of other directions move more or less, um.

    Half of what a wavefront error makes them differ by, arguments as in `dilation_um`.
    """
    if coherence is None:
        return 0.0
    added = _added_um(coherence, microscope, contrast)
    return float(np.ptp(added, axis=1).max()) / 2


def _added_um(
    coherence: Coherence, microscope: Microscope, contrast: float
) -> FloatArray:
    """Return what a wavefront error adds, (S, D) um, by coherence and direction."""
    return np.array(
        [aberrated_offsets_um(s, microscope, contrast) for s in coherence.samples]
    )


def differing_um(coherence: Coherence | None, microscope: Microscope) -> float:
    """Return how far edges of one contrast may move against those of another, um.

    Half of how far edges of full contrast move.
    """
    if coherence is None:
        return 0.0
    return DIFFERENT * dilation_um(coherence, microscope, 1.0)[1]
