"""Results of pure functions kept on disk, found by what went into them."""
