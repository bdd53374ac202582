"""Fourier transforms of real volumes and of batches of images, in single precision.

In: float32 arrays on the device. Out: half spectra, complex64 (n0, n1, `row_pitch(n2)`), and back. `transform.py` is
the class to use, `edges.py` has the edges that it takes; the other modules write its OpenCL source, for processors
(`cpu.py`) and graphics processors (`gpu.py`).
"""
