"""Two scans in, one 6-DoF registration with its uncertainty out."""
