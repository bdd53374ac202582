"""What one scan contributes to every pair, computed once.

In: a `Scan` and the grid. Out: `Prepared` (voxels and spectra), which both methods use; for the spectral method also
the surface with normals, the range image of what the sensor saw, and the signature for place recognition, all together
in a `SpectralScan`.
"""
