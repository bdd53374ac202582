"""The map: points of all scans fused and cleared by free space, and the distance between overlapping passes.

In: scans and their poses with covariances. Out: a `PointMap` per component and survey, and the `CrossingError`.
"""
