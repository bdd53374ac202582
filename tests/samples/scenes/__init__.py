"""What is scanned: rooms, reliefs, structures, layers of spheres, simulated scenes."""
