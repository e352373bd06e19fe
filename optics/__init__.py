"""What the camera sees: pure functions of arrays, and imports nothing of ours."""
