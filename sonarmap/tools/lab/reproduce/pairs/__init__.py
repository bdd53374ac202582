"""Pairs of every overlap, by every method: what is right, what is accepted, and whether covariances are calibrated."""
