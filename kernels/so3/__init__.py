"""Layers on the sphere correlated over all rotations.

In: layers (L, latitudes, longitudes) of magnitudes. Out: spherical-harmonic coefficients (`harmonics.py`, on the host)
and their correlation over SO(3) on the device (`correlation.py`).
"""
