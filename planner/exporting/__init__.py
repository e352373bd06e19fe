"""Plans in the formats of other tools: outlines, pictures, sequences of views."""
