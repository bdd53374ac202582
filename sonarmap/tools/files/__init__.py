"""Reading and writing files: scan and table readers, writers, the map folder, and georeferencing."""
