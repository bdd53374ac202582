"""Pose graphs from files: the full or the isotropic cost, from several starts, with a certificate of optimality.

In: a `PoseGraph`. Out: an `Optimized` graph with costs, residuals, rejected edges and the certificate.
"""
