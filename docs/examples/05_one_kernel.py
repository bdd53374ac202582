"""A kernel alone: the shift between two volumes by phase-only matched filtering (POMF) on an OpenCL device."""

import numpy as np

from sonarmap import kernels

device = kernels.choose_device()
print(f"on {device.name}")

rng = np.random.default_rng(3)
target = rng.random((64, 64, 64), np.float32)
shift = (5, -12, 20)
# The convention of the kernels: p_target = p_source + shift, so that the source lies the other way.
source = np.roll(target, [-s for s in shift], axis=(0, 1, 2)) + rng.normal(0, 0.5, target.shape).astype(np.float32)

pomf = kernels.Pomf(device, target.shape)
spectra = [pomf.prepare(device.to_device(volume)) for volume in (target, source)]
peak = kernels.find_peaks(device, pomf.correlate(*spectra))[0]
print(f"shifted by {peak.shift.round(1)}, the peak is {peak.psr:.0f} standard deviations high")
assert np.allclose(peak.shift, shift, atol=0.2)
