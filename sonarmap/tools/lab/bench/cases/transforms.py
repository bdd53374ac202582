"""Copying and the Fourier transforms."""

import numpy as np

from sonarmap.kernels.fft.transform import RealFFT
from sonarmap.tools.lab.bench import twins
from sonarmap.tools.lab.bench.case import (
    FFT,
    KernelCase,
    half_bytes,
    transform_flops,
    transform_passes,
    valid,
    volume_bytes,
)
from sonarmap.tools.lab.bench.peers import fft_peers
from sonarmap.tools.lab.bench.rates import copier
from sonarmap.tools.lab.bench.traffic import Traffic
from sonarmap.tools.lab.bench.workload import Workload


def copy_case(w: Workload) -> KernelCase:
    run, read = copier(w.device, w.volume)
    out = np.empty_like(w.volume)

    def twin() -> np.ndarray:
        np.copyto(out, w.volume)
        return out

    return KernelCase("copy", "np.copyto", Traffic(volume_bytes(w), volume_bytes(w)), 0.0, run, read, twin)


def real_forward_case(w: Workload) -> KernelCase:
    fft = RealFFT(w.device, w.volume.shape)
    volume, out = w.upload(w.volume), w.device.empty(fft.half_shape, np.complex64)
    return KernelCase(
        "RealFFT.forward",
        "scipy.fft.rfftn",
        Traffic(volume_bytes(w), half_bytes(w), 2 * half_bytes(w)),
        FFT,
        run=lambda: fft.forward(volume, out=out),
        read=lambda: valid(out),
        twin=lambda: twins.forward(w.volume, w.cores),
        flops=transform_flops(w),
        passes=transform_passes(w),
        peers=lambda: fft_peers(w, inverse=False),
    )


def real_inverse_case(w: Workload) -> KernelCase:
    fft = RealFFT(w.device, w.volume.shape)
    padded = w.pad(w.spectrum)
    spectrum = w.upload(padded)
    out = w.device.empty(fft.shape)
    return KernelCase(
        "RealFFT.inverse",
        "scipy.fft.irfftn",
        Traffic(half_bytes(w), volume_bytes(w), 2 * half_bytes(w)),
        FFT,
        run=lambda: fft.inverse(spectrum, out=out),
        read=out.get,
        twin=lambda: twins.inverse(w.spectrum, w.cores),
        restore=lambda: spectrum.set(padded),
        flops=transform_flops(w),
        passes=transform_passes(w),
        peers=lambda: fft_peers(w, inverse=True),
    )
