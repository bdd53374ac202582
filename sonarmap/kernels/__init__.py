"""OpenCL kernels and the Python functions that launch them; nothing here knows what a sonar is.

In: device arrays and NumPy arrays. Out: device arrays, and peaks as NumPy numbers. `device/` finds devices and launches
programs, `fft/` transforms volumes, `points/` puts points into voxels and views, `pomf/` correlates spectra and finds
peaks, `resample/` samples spectra on layers, `so3/` correlates layers over all rotations, `surface/` finds nearest
points and fits surfaces to each other. Every kernel is compared with NumPy or SciPy in its test.

Arrays of the wrong shape, dtype or order and numbers out of range raise an InputError. A device that lacks memory or
cannot build a program raises a DeviceError.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
