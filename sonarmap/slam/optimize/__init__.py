"""Pose graphs from files: the optimum of their edges, from several starts.

In: a `PoseGraph`. Out: an `Optimized` graph with chi-squared, residuals and rejected edges.
"""
