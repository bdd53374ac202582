"""What is done to spectra and correlations."""

import numpy as np

from kernels.pomf.peak import find_peaks
from kernels.pomf.spectrum import Pomf, cross_power, magnitude, whiten
from tools.bench import twins
from tools.bench.case import BLUR, ELEMENTWISE, WHITENED, KernelCase, half_bytes, transform_bytes, valid
from tools.bench.workload import Workload


def magnitude_case(w: Workload) -> KernelCase:
    spectrum, out = w.upload_half(w.spectrum), w.device.empty((w.edge, w.edge, w.edge // 2 + 1))
    return KernelCase(
        "magnitude",
        "np.abs, fftshift",
        half_bytes(w) * 3 // 2,
        ELEMENTWISE,
        run=lambda: magnitude(w.device, spectrum, w.edge, out=out),
        read=out.get,
        twin=lambda: twins.magnitude(w.spectrum),
    )


def whiten_case(w: Workload) -> KernelCase:
    spectrum = w.upload_half(w.spectrum)
    out, host = w.device.empty(spectrum.shape, np.complex64), np.empty_like(w.spectrum)
    return KernelCase(
        "whiten",
        "np.abs, np.divide",
        2 * half_bytes(w),
        ELEMENTWISE,
        run=lambda: whiten(w.device, spectrum, out=out),
        read=lambda: valid(out),
        twin=lambda: twins.whiten(w.spectrum, host),
    )


def cross_power_case(w: Workload) -> KernelCase:
    target, source = (w.upload_half(spectrum) for spectrum in w.whitened)
    out, host = w.device.empty(target.shape, np.complex64), np.empty_like(w.spectrum)
    return KernelCase(
        "cross_power",
        "NumPy products",
        3 * half_bytes(w),
        ELEMENTWISE,
        run=lambda: cross_power(w.device, target, source, w.volume.shape, BLUR, out=out),
        read=lambda: valid(out),
        twin=lambda: twins.cross_power(*w.whitened, BLUR, host),
    )


def prepare_case(w: Workload) -> KernelCase:
    pomf = Pomf(w.device, w.volume.shape, BLUR)
    volume, out = w.upload(w.volume), w.upload_half(w.spectrum)
    return KernelCase(
        "Pomf.prepare",
        "scipy.fft.rfftn, NumPy",
        transform_bytes(w) + 2 * half_bytes(w),
        WHITENED,
        run=lambda: pomf.prepare(volume, out=out),
        read=lambda: valid(out),
        twin=lambda: twins.prepare(w.volume, w.cores),
    )


def correlate_case(w: Workload) -> KernelCase:
    pomf = Pomf(w.device, w.volume.shape, BLUR)
    target, source = (w.upload_half(spectrum) for spectrum in w.whitened)
    out, scratch = w.device.empty(w.volume.shape), np.empty_like(w.spectrum)
    return KernelCase(
        "Pomf.correlate",
        "NumPy, scipy.fft.irfftn",
        3 * half_bytes(w) + transform_bytes(w),
        WHITENED,
        run=lambda: pomf.correlate(target, source, out=out),
        read=out.get,
        twin=lambda: twins.correlate(*w.whitened, BLUR, scratch, w.cores),
    )


def find_peaks_case(w: Workload) -> KernelCase:
    host = twins.correlate(*w.whitened, BLUR, np.empty_like(w.spectrum), w.cores)
    correlation = w.upload(host)
    peaks = []

    def run() -> None:
        peaks[:] = find_peaks(w.device, correlation)

    def read() -> np.ndarray:
        peak = peaks[0]
        return np.concatenate(
            [peak.index, [peak.value, (peak.value - peak.mean) / peak.std], peak.neighborhood.ravel()]
        )

    return KernelCase("find_peaks", "np.argmax, mean, std", host.nbytes, 1e-5, run, read, lambda: twins.peak(host))
