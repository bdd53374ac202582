"""Cases of spectra and correlations; transforms are also compared with other libraries that are installed."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from sonarmap.kernels.fft.transform import RealFFT
from sonarmap.kernels.pomf.peak import find_peaks
from sonarmap.kernels.pomf.spectrum import Pomf, cross_power, magnitude, whiten
from sonarmap.tools.lab.bench.case import BLUR, KernelCase, Peer
from sonarmap.tools.lab.bench.timing import copier
from sonarmap.tools.lab.bench.workload import Workload


def copy_case(w: Workload) -> KernelCase:
    return KernelCase("copy", 2 * w.volume_bytes, copier(w.device, w.volume))


def real_forward_case(w: Workload) -> KernelCase:
    fft = RealFFT(w.device, w.volume.shape)
    volume, out = w.upload(w.volume), w.device.empty(fft.half_shape, np.complex64)
    return KernelCase(
        "RealFFT.forward",
        w.volume_bytes + 3 * w.half_bytes,
        run=lambda: fft.forward(volume, out=out),
        peers=lambda: fft_peers(w, inverse=False),
    )


def real_inverse_case(w: Workload) -> KernelCase:
    fft = RealFFT(w.device, w.volume.shape)
    padded = w.pad(w.spectrum)
    spectrum = w.upload(padded)
    out = w.device.empty(fft.shape)
    return KernelCase(
        "RealFFT.inverse",
        3 * w.half_bytes + w.volume_bytes,
        run=lambda: fft.inverse(spectrum, out=out),
        restore=lambda: spectrum.set(padded),
        peers=lambda: fft_peers(w, inverse=True),
    )


def magnitude_case(w: Workload) -> KernelCase:
    spectrum, out = w.upload_half(w.spectrum), w.device.empty((w.edge, w.edge, w.edge // 2 + 1))
    return KernelCase(
        "magnitude",
        w.half_bytes + w.half_bytes // 2,
        run=lambda: magnitude(w.device, spectrum, w.edge, out=out),
    )


def whiten_case(w: Workload) -> KernelCase:
    spectrum = w.upload_half(w.spectrum)
    out = w.device.empty(spectrum.shape, np.complex64)
    return KernelCase("whiten", 2 * w.half_bytes, run=lambda: whiten(w.device, spectrum, out=out))


def cross_power_case(w: Workload) -> KernelCase:
    target, source = _whitened(w)
    out = w.device.empty(target.shape, np.complex64)
    return KernelCase(
        "cross_power",
        3 * w.half_bytes,
        run=lambda: cross_power(w.device, target, source, w.volume.shape, (BLUR, BLUR, BLUR), out=out),
    )


def prepare_case(w: Workload) -> KernelCase:
    pomf = Pomf(w.device, w.volume.shape, BLUR)
    volume, out = w.upload(w.volume), w.upload_half(w.spectrum)
    return KernelCase(
        "Pomf.prepare",
        w.volume_bytes + 3 * w.half_bytes,  # whitening can be fused into the last pass
        run=lambda: pomf.prepare(volume, out=out),
    )


def correlate_case(w: Workload) -> KernelCase:
    pomf = Pomf(w.device, w.volume.shape, BLUR)
    target, source = _whitened(w)
    out = w.device.empty(w.volume.shape)
    return KernelCase(
        "Pomf.correlate",
        4 * w.half_bytes + w.volume_bytes,  # the product can be fused into the first pass
        run=lambda: pomf.correlate(target, source, out=out),
    )


def find_peaks_case(w: Workload) -> KernelCase:
    correlation = Pomf(w.device, w.volume.shape, BLUR).correlate(*_whitened(w))
    return KernelCase("find_peaks", w.volume_bytes, run=lambda: find_peaks(w.device, correlation))


def _whitened(w: Workload) -> tuple[Any, Any]:
    """Whitened half spectra on the device: of a target, the shifted source plus noise, and of the source."""
    pomf = Pomf(w.device, w.volume.shape)
    return pomf.prepare(w.upload(w.shifted)), pomf.prepare(w.upload(w.volume))


def fft_peers(w: Workload, inverse: bool) -> list[Peer]:
    """The installed ones of FFTW (planned by measuring, with a thread per core) and VkFFT on the same device."""
    peers = [_pyfftw(w, inverse)] if find_spec("pyfftw") else []
    return peers + ([_pyvkfft(w, inverse)] if find_spec("pyvkfft") else [])


def peer_versions() -> dict[str, str]:
    """Versions of the installed peers."""
    from importlib.metadata import version

    return {name: version(name) for name in ("pyfftw", "pyvkfft") if find_spec(name)}


def _pyfftw(w: Workload, inverse: bool) -> Peer:
    import pyfftw

    volume = pyfftw.empty_aligned(w.volume.shape, np.float32)
    spectrum = pyfftw.empty_aligned(w.spectrum.shape, np.complex64)
    input_array, output_array, source = (spectrum, volume, w.spectrum) if inverse else (volume, spectrum, w.volume)
    plan = pyfftw.FFTW(
        input_array,
        output_array,
        axes=(0, 1, 2),
        direction="FFTW_BACKWARD" if inverse else "FFTW_FORWARD",
        flags=("FFTW_MEASURE",),
        threads=w.cores,
    )
    input_array[:] = source  # planning overwrites input and output

    def restore() -> None:
        if inverse:  # the inverse overwrites its input
            input_array[:] = source

    restore()
    return Peer("pyfftw", plan.execute if not inverse else plan, restore)


def _pyvkfft(w: Workload, inverse: bool) -> Peer:
    # not a dependency of sonarmap, as pip has to compile it
    app_class = import_module("pyvkfft.opencl").VkFFTApp
    queue = w.device.queue
    app = app_class(w.volume.shape, np.float32, queue, r2c=True, inplace=False)
    input_array = w.upload(w.spectrum if inverse else w.volume)
    output = w.device.empty(w.volume.shape, np.float32) if inverse else w.device.empty(w.spectrum.shape, np.complex64)
    work = app.ifft if inverse else app.fft

    def run() -> None:
        work(input_array, output)
        queue.finish()

    return Peer("pyvkfft", run, (lambda: input_array.set(w.spectrum)) if inverse else (lambda: None))
