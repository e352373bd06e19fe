"""Coherence."""
