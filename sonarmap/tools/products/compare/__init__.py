"""Changes between two surveys of a place: their alignment, distances with levels of detection, and changed regions."""
