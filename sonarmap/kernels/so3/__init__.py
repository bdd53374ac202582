"""Layers on the sphere correlated over all rotations.

In: a magnitude spectrum. Out: spherical-harmonic coefficients of its layers (`harmonics.py`), and the correlation of
two scans' over SO(3) with its peaks (`correlation.py`), all of it on the device.
"""
