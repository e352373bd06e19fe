"""DXF drawings: tags, entities, blocks, curves of a file, read without repairs.

In: the bytes of a file, from planner.task.drawings.
Out: pieces of outlines (`Drawn`) to planner.drawings; an outline (`Taken`) to
planner.task; counts of entities (`census`) to the second reader.
The type that passes: `DxfFile` (planner.drawings.dxf.file), then `Drawn`.
May be touched here: kinds of entities that are read (`READERS`), limits of work.
Only `ezdxf_reading` imports ezdxf, in a process of its own.
Watched by: tests/planner/drawings/dxf/test_corpus.py, test_drawing.py.
"""
