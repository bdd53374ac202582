"""A map that grows while scans arrive: each scan is placed at once, and loops are searched for from time to time."""
