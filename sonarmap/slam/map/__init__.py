"""The map: points of all scans fused, cleared by free space, and how far overlapping passes lie apart.

In: scans and their poses with covariances. Out: a `PointMap` per component and survey, and the `CrossingError`.
"""
