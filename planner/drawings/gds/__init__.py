"""GDSII drawings: records, cells, shapes of a library, united into rings.

In: the bytes of a stream file, from planner.task.drawings.
Out: an outline in um (`Taken`), to planner.task.
The type that passes: `Library` (planner.drawings.gds.library), then `Regions`.
May be touched here: records that are passed over, limits of work, words of findings.
Ask first: `GRID`, `SLIVER`, the recognition of circles: outlines depend on them.
Watched by: tests/planner/drawings/gds/test_drawing.py, test_records.py.
"""
