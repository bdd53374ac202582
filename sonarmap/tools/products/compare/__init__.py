"""What changed between two surveys of a place: one brought onto the other, distances, levels of detection, regions."""
