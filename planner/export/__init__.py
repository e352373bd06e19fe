"""A plan's looks in the formats of other programs: DXF, JSON, OME-TIFF, useq.

In: `Plan`, `World`, `Scenes` and pictures of a plan folder.
Out: files that are whole or absent; the same plan gives the same bytes.
The type that passes: `ExportedPlan` (folder).
May be touched here: layers, names and notes in the files. ezdxf is imported in dxf
alone, tifffile in ome alone, and neither for another format.
Watched by: tests/planner/export/test_export.py
"""
