"""Twins: microscope pictures whose truth is known, made from first principles.

`scenes` says what lies there, `optics` images it, `camera` counts it, `series` makes
frames of it. Lengths are um, angles rad, counter-clockwise; y is up.
"""
