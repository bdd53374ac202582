"""Correlation of layers on the sphere over all rotations.

In: a magnitude spectrum. Out: spherical-harmonic coefficients of its layers (`harmonics.py`), and the correlation of
two scans' coefficients over SO(3) with its peaks (`correlation.py`), all on the device.
"""
