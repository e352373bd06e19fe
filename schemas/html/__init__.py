"""Pages that say what plans and runs hold: one HTML file each, without scripts."""
