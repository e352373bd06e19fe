"""Outlines as fabricated, and which of them goes over which.

In: rings of numbers (schemas.files.world), offsets of their edges, poses.
Out: whether a post's outline lies in a hole's; the smallest motion that puts it there;
where flat jaws turn a part.
The type that passes: `FabricatedRing` (fabricated).
May be touched here: the models, but never by what the compiler uses for the same
question: the cell is its judge. Standard library and numpy alone.
Watched by: tests/executor/simulated/outlines.
"""
