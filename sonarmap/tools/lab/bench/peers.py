"""Other libraries' Fourier transforms of the same volumes, where they are installed."""

from importlib import import_module
from importlib.util import find_spec

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.bench.case import Peer
from sonarmap.tools.lab.bench.workload import Workload


def fft_peers(w: Workload, inverse: bool) -> list[Peer]:
    """FFTW, planned by measuring, with as many threads as the twins; VkFFT on the same device.

    Args:
        inverse: from the half spectrum to the volume.
    """
    made = [_pyfftw(w, inverse)] if find_spec("pyfftw") else []
    return made + ([_pyvkfft(w, inverse)] if find_spec("pyvkfft") else [])


def peer_versions() -> dict[str, str]:
    """The versions of those that are installed."""
    from importlib.metadata import version

    return {name: version(name) for name in ("pyfftw", "pyvkfft") if find_spec(name)}


def _pyfftw(w: Workload, inverse: bool) -> Peer:
    import pyfftw

    volume = pyfftw.empty_aligned(w.volume.shape, np.float32)
    spectrum = pyfftw.empty_aligned(w.spectrum.shape, np.complex64)
    given, made, source = (spectrum, volume, w.spectrum) if inverse else (volume, spectrum, w.volume)
    plan = pyfftw.FFTW(
        given,
        made,
        axes=(0, 1, 2),
        direction="FFTW_BACKWARD" if inverse else "FFTW_FORWARD",
        flags=("FFTW_MEASURE",),
        threads=w.cores,
    )
    given[:] = source  # planning overwrites both

    def restore() -> None:
        if inverse:  # which overwrites its input
            given[:] = source

    wanted = w.volume if inverse else w.spectrum
    if not np.linalg.norm(plan() - wanted) <= 1e-5 * np.linalg.norm(wanted):  # what computes something else is no peer
        raise InputError("pyfftw gives another spectrum than scipy.fft; uninstall it or take another version")
    restore()
    return Peer("pyfftw", plan.execute if not inverse else plan, restore)


def _pyvkfft(w: Workload, inverse: bool) -> Peer:
    # no dependency of ours: it is compiled where it is installed
    app_class = import_module("pyvkfft.opencl").VkFFTApp
    queue = w.device.queue
    app = app_class(w.volume.shape, np.float32, queue, r2c=True, inplace=False)
    given = w.upload(w.spectrum if inverse else w.volume)
    made = w.device.empty(w.volume.shape, np.float32) if inverse else w.device.empty(w.spectrum.shape, np.complex64)
    work = app.ifft if inverse else app.fft

    def run() -> None:
        work(given, made)
        queue.finish()

    return Peer("pyvkfft", run, (lambda: given.set(w.spectrum)) if inverse else (lambda: None))
