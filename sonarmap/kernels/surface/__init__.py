"""Surfaces as points in cells: nearest neighbors, fitted planes, the overlap of two surfaces, and refined poses.

In: points, normals and poses. Out: neighbors, smoothed surfaces, overlaps, and refined poses with the sums that rate
their fits. `cells.cl` holds the nearest-neighbor search that all of them use.
"""
