"""Tradeoff."""
