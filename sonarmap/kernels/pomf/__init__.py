"""Phase-only matched filtering: whiten and correlate spectra, and find the peaks of the correlation.

In: volumes, or half spectra from `kernels.fft`. Out: correlations on the device, and `Peak`s with sub-voxel shifts.
"""
