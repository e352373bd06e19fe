"""A real point source through focus, and what the compiler's optics make of it.

`series.tif` is cut from `fixtures/psf_wl520nm_z300nm_x130nm_na0.85_n1.0.tif` of the
public repository david-hoffman/pyOTF (commit 7fb39dbc): rows 96 to 159 and columns 99
to 162 of all 25 planes. The licence beside it is that of the source.
"""
