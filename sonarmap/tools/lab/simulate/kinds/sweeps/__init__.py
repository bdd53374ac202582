"""Scans that a narrow fan or beam gathers while its vehicle moves: swaths, stacked images, profiles.

In: a number, a seed, a scene, a wanted overlap. Out: a `KindPair`.
"""
