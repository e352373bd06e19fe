"""Files in, typed values out: YAML with positions, task, workcell, drawings."""
