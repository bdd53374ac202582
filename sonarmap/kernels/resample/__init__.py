"""Magnitude spectra sampled in coordinates in which a rotation is a shift.

In: centered magnitude spectra on the device. Out: layers of images over directions (`sphere.cl`) or over radius and
angle (`polar.cl`), normalized (`layers.cl`).
"""
