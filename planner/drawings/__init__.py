"""Drawings: rings, nesting, overlaps, biarcs, whatever the format of the file.

In: pieces of outlines (`Piece`), from drawings.dxf, or shapes, from drawings.gds.
Out: one outline in um with its layers (`Taken`), to planner.task.
The type that passes: `Taken` (planner.drawings.census).
May be touched here: the words of findings MP202 to MP225, limits of size and time.
Ask first: tolerances (`GAP_UM`, `CURVE_UM`, `SAME_UM`): plans depend on them.
No file is opened here: bytes come in, findings go to the report.
Watched by: tests/planner/drawings/test_rings.py, test_census.py.
"""
