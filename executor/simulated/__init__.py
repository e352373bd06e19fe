"""A simulated workcell: its own world, contact rules, camera and drivers."""
