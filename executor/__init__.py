"""The runtime: a plan in, motion out. Imports the standard library and numpy only."""
