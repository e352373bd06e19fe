"""Partially coherent light: Abbe images, errors of incoherent ones.

In: `Scene`, `Microscope`, the condenser's aperture over the objective's. Out: images by
Abbe's sum, and edge offsets and errors from tables, to optics.ledger and planner.views.
The type that passes: `LightSource` (source).
May be touched here: sampling of the source within `source_error`; the table comes from
`python -m benchmarks.optics.edge_table`.
Watched by: tests/optics/coherence/test_coherence.py, test_coherent_wavefront.py and
test_edge_offsets.py.
"""
