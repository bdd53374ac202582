# pyright: strict
"""Fourier transforms of real volumes and of batches of images, in single precision.

In: float32 arrays on the device. Out: half spectra, complex64 (n0, n1, n2 / 2 + 8), and back. `transform.py` is the
class to use; the other modules write its OpenCL source, for processors (`cpu.py`) and graphics processors (`gpu.py`).
"""
