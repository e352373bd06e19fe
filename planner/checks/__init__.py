"""Verdicts: will the parts fit, is the error budget met."""
