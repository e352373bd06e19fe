"""Light that is not coaxial: from below, and from a ring around the objective.

In: `Scene` whose layers send what this light makes them send, `Microscope` (with the
aperture of a lamp below), `RingLamp`; layers blurred by optics.render. Out: noise-free
images to featuresel.look and planner.looks.
The type that passes: `Lamp` (lamps).
May be touched here: directions and lattices of the ring, stairs of a mirrored strip:
within what tests/optics/light traces; how many clear bodies are rendered.
Watched by: tests/optics/light/test_transmitted.py and test_ring.py.
"""
