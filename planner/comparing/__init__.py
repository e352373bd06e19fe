"""What changed between two plans, in meaning."""
