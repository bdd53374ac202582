"""Fourier transforms of real volumes and of batches of images, in single precision.

In: float32 arrays on the device. Out: half spectra, complex64 (n0, n1, `row_pitch(n2)`), and back. `transform.py` has
the class to use, `edges.py` the edges that it supports; the other modules generate its OpenCL source, for processors
(`cpu.py`) and graphics processors (`gpu.py`).
"""
