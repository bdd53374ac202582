"""What registrations need on the device, known before anything is allocated."""

from kernels.device import Device
from kernels.errors import DeviceError
from spectral.grid import EDGES


def require_memory(device: Device, edge: int) -> None:
    """Refuse a grid that the device cannot hold together with two prepared scans.

    Raises:
        DeviceError: saying how much is needed and which grid would fit.
    """
    smaller = [e for e in reversed(EDGES) if e < edge]
    fitting = next((e for e in smaller if _fits(device, e)), None)
    device.require(*_memory(edge), hint=f"--grid {fitting}" if fitting else "another device")


def scans_that_fit(device: Device, edge: int) -> int:
    """How many prepared scans the device can hold beside what a pair needs."""
    return max(0, device.memory - _scratch(edge)) // _prepared(edge)


def _fits(device: Device, edge: int) -> bool:
    try:
        device.require(*_memory(edge), hint="")
    except DeviceError:
        return False
    return True


def _memory(edge: int) -> tuple[int, int]:
    """What a pair needs on a grid: its largest single array and all of them together [bytes]."""
    largest = max(_half_spectrum(edge), _tilt_spectra(edge), 4 * edge**3)
    return largest, 2 * _prepared(edge) + _scratch(edge)


def _prepared(edge: int) -> int:
    """One prepared scan [bytes]: its spectrum, its magnitudes, its layers."""
    return (_half_spectrum(edge) + _tilt_spectra(edge)) * 3 // 2


def _scratch(edge: int) -> int:
    """What is used again by each pair [bytes]: volumes, spectra, stacks of layers."""
    stack = 4 * 2 * _layers(edge) * edge**2
    return 3 * 4 * edge**3 + 3 * _half_spectrum(edge) + 2 * stack + _tilt_spectra(edge)


def _half_spectrum(edge: int) -> int:
    return 8 * edge**2 * (edge // 2 + 8)


def _tilt_spectra(edge: int) -> int:
    return 8 * 2 * _layers(edge) * edge * (edge // 2 + 8)


def _layers(edge: int) -> int:
    return int(0.6 * edge / 2) + 1
