"""What a scan contributes to all its pairs, computed once.

In: a `Scan` and the grid. Out: `Prepared` (voxels and spectra), which both methods use, and for the spectral method a
`SpectralScan`, which adds the surface with normals, the sensor's range images, and the signature for place
recognition.
"""
