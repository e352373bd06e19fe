"""Values out as files: the plan folder and its pictures."""
