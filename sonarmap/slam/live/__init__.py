"""A map that grows while scans come: each is placed at once, and all is decided anew now and then."""
