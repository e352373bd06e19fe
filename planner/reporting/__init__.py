"""The report of a plan: one page, made from the plan folder alone."""
