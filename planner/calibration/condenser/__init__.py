"""Coherence of coaxial light: a known part at several settings of the condenser.

In: pictures in focus with readings of the condenser, a drawing, the workcell.
Out: condenser over objective aperture at each setting, and the part's own edge offset.
The type that passes: `CondenserLook` (condenser_fit), `CoherentProfiles`.
May be touched here: profiles across edges; images come from optics.coherence.
Watched by: tests/planner/calibration/condenser
"""
