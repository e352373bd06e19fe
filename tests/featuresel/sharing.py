"""What images that share transforms may differ by from images rendered anew."""

from __future__ import annotations

from microplan.optics.render.sampling import FAR_ERROR, Sampling

# All of the band, and a margin to which the blur of 40 um adds no more than 1e-5.
FINE = Sampling(band_error=1e-12, margin=300.0)
# Tiles are corrected apart, and margins differ by the blur of the range.
SHARED = 2 * FAR_ERROR + 1e-5
