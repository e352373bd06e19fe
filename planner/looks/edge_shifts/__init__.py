"""What moves all edges of a look alike and is known between two ends alone.

In: a look with its chosen chain; the workcell's coherence, and whether it states the
camera's response. Out: half-widths of a bias, and the ledger's rows of them.
The type that passes: `CoherenceShift`, `ResponseShift`.
May be touched here: which images the chain is given; the ends belong to optics.
Watched by: tests/planner/looks/edge_shifts.
"""
