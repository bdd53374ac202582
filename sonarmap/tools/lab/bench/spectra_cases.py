"""Cases of spectra and correlations; transforms are also compared with other libraries that are installed."""

from importlib import import_module
from importlib.util import find_spec

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.kernels.fft.transform import RealFFT
from sonarmap.kernels.pomf.peak import find_peaks
from sonarmap.kernels.pomf.spectrum import Pomf, cross_power, magnitude, whiten
from sonarmap.tools.lab.bench import twins
from sonarmap.tools.lab.bench.case import (
    BLUR,
    ELEMENTWISE,
    FFT,
    WHITENED,
    KernelCase,
    Peer,
    peak_numbers,
    valid,
)
from sonarmap.tools.lab.bench.timing import copier
from sonarmap.tools.lab.bench.workload import Workload


def copy_case(w: Workload) -> KernelCase:
    out = np.empty_like(w.volume)

    def twin() -> np.ndarray:
        np.copyto(out, w.volume)
        return out

    return KernelCase("copy", "np.copyto", 2 * w.volume_bytes, 0.0, copier(w.device, w.volume), twin)


def real_forward_case(w: Workload) -> KernelCase:
    fft = RealFFT(w.device, w.volume.shape)
    volume, out = w.upload(w.volume), w.device.empty(fft.half_shape, np.complex64)
    return KernelCase(
        "RealFFT.forward",
        "scipy.fft.rfftn",
        w.volume_bytes + 3 * w.half_bytes,
        FFT,
        run=lambda: fft.forward(volume, out=out),
        read=valid,
        twin=lambda: twins.forward(w.volume, w.cores),
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
        3 * w.half_bytes + w.volume_bytes,
        FFT,
        run=lambda: fft.inverse(spectrum, out=out),
        twin=lambda: twins.inverse(w.spectrum, w.cores),
        restore=lambda: spectrum.set(padded),
        peers=lambda: fft_peers(w, inverse=True),
    )


def magnitude_case(w: Workload) -> KernelCase:
    spectrum, out = w.upload_half(w.spectrum), w.device.empty((w.edge, w.edge, w.edge // 2 + 1))
    return KernelCase(
        "magnitude",
        "np.abs, fftshift",
        w.half_bytes + w.half_bytes // 2,
        ELEMENTWISE,
        run=lambda: magnitude(w.device, spectrum, w.edge, out=out),
        twin=lambda: twins.magnitude(w.spectrum),
    )


def whiten_case(w: Workload) -> KernelCase:
    spectrum = w.upload_half(w.spectrum)
    out, host = w.device.empty(spectrum.shape, np.complex64), np.empty_like(w.spectrum)
    return KernelCase(
        "whiten",
        "np.abs, np.divide",
        2 * w.half_bytes,
        ELEMENTWISE,
        run=lambda: whiten(w.device, spectrum, out=out),
        read=valid,
        twin=lambda: twins.whiten(w.spectrum, host),
    )


def cross_power_case(w: Workload) -> KernelCase:
    target, source = (w.upload_half(spectrum) for spectrum in w.whitened)
    out, host = w.device.empty(target.shape, np.complex64), np.empty_like(w.spectrum)
    return KernelCase(
        "cross_power",
        "NumPy products",
        3 * w.half_bytes,
        ELEMENTWISE,
        run=lambda: cross_power(w.device, target, source, w.volume.shape, (BLUR, BLUR, BLUR), out=out),
        read=valid,
        twin=lambda: twins.cross_power(*w.whitened, BLUR, host),
    )


def prepare_case(w: Workload) -> KernelCase:
    pomf = Pomf(w.device, w.volume.shape, BLUR)
    volume, out = w.upload(w.volume), w.upload_half(w.spectrum)
    return KernelCase(
        "Pomf.prepare",
        "scipy.fft.rfftn, NumPy",
        w.volume_bytes + 3 * w.half_bytes,  # whitening can be fused into the last pass
        WHITENED,
        run=lambda: pomf.prepare(volume, out=out),
        read=valid,
        twin=lambda: twins.prepare(w.volume, w.cores),
    )


def correlate_case(w: Workload) -> KernelCase:
    pomf = Pomf(w.device, w.volume.shape, BLUR)
    target, source = (w.upload_half(spectrum) for spectrum in w.whitened)
    out, scratch = w.device.empty(w.volume.shape), np.empty_like(w.spectrum)
    return KernelCase(
        "Pomf.correlate",
        "NumPy, scipy.fft.irfftn",
        4 * w.half_bytes + w.volume_bytes,  # the product can be fused into the first pass
        WHITENED,
        run=lambda: pomf.correlate(target, source, out=out),
        twin=lambda: twins.correlate(*w.whitened, BLUR, scratch, w.cores),
    )


def find_peaks_case(w: Workload) -> KernelCase:
    host = twins.correlate(*w.whitened, BLUR, np.empty_like(w.spectrum), w.cores)
    correlation = w.upload(host)
    return KernelCase(
        "find_peaks",
        "np.argmax, mean, std",
        host.nbytes,
        1e-5,
        run=lambda: find_peaks(w.device, correlation)[0],
        read=peak_numbers,
        twin=lambda: twins.peak(host),
    )


def fft_peers(w: Workload, inverse: bool) -> list[Peer]:
    """The installed ones of FFTW (planned by measuring, with the threads of the twins) and VkFFT on the same device."""
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

    wanted = w.volume if inverse else w.spectrum
    if not np.linalg.norm(plan() - wanted) <= 1e-5 * np.linalg.norm(wanted):
        raise InputError("the results of pyfftw and scipy.fft differ; uninstall pyfftw or install another version")
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
