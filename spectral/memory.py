"""How much device memory a registration needs, by either method, known before anything is allocated."""

from kernels.device.device import Device
from kernels.errors import DeviceError
from kernels.fft.edges import EDGES, row_pitch
from kernels.pomf.correlator import at_once
from spectral.grid import coarse_edge, image_edge

# Tables and correlations over all rotations, of any tilt: the same on every grid.
_ROTATIONS = 160 * 2**20
_LARGEST_TABLE = 42 * 2**20
# Points of a scan on two grids: up to 200,000 of 16 bytes are assumed.
_POINTS = 2 * 16 * 200_000
# A surface has about as many points as a face of the grid has voxels, in two sets of cells: bytes of each point.
_SURFACE = 2 * (16 + 16 * 4) + 48
# The range image of a scan, the sample of points that is compared with others', and the harmonics of its layers.
_VIEW = 2**18 + 2**20


def require_memory(device: Device, edge: int) -> None:
    """Refuse a grid that the device cannot hold together with two prepared scans.

    Raises:
        DeviceError: saying how much is needed and which grid would fit.
    """
    smaller = [e for e in reversed(EDGES) if e < edge]
    fitting = next((e for e in smaller if _fits(device, e)), None)
    device.require(*needed_memory(edge), hint=f"`edge={fitting}`" if fitting else "another device")


def scans_that_fit(device: Device, edge: int) -> int:
    """How many prepared scans the device can hold beside what a pair needs."""
    return max(0, device.memory - _scratch(edge)) // prepared_memory(edge)


def needed_memory(edge: int) -> tuple[int, int]:
    """What a pair needs on a grid: its largest single array and all of them together [bytes]."""
    largest = max(_half_spectrum(edge), _tilt_spectra(edge), _volume(edge), _LARGEST_TABLE)
    return largest, 2 * prepared_memory(edge) + _scratch(edge)


def prepared_memory(edge: int) -> int:
    """One prepared scan [bytes]: points, spectrum, magnitudes; and its layers, or what the coarse grid needs."""
    layers = _tilt_spectra(edge) * 7 // 4
    coarse = _half_spectrum(coarse_edge(edge)) + _VIEW
    surface = _SURFACE * min(edge**2, 200_000)
    return _POINTS + surface + _half_spectrum(edge) + _magnitude(edge) + max(layers, coarse)


def _fits(device: Device, edge: int) -> bool:
    try:
        device.require(*needed_memory(edge), hint="")
    except DeviceError:
        return False
    return True


def _scratch(edge: int) -> int:
    """What is used again by each pair [bytes]: volumes, spectra, and stacks of layers or what is known of rotations."""
    stack = 4 * 2 * _layers(edge) * image_edge(edge) ** 2
    hemisphere = _volume(edge) + _correlations(edge, 1, 1) + 2 * stack + _tilt_spectra(edge)
    coarse = coarse_edge(edge)
    # the coarse grid's scans have two spectra each, as many poses as fill a small device are worked on at once there
    rotations = _volume(edge) + _correlations(edge, 1, 1) + _ROTATIONS
    rotations += _volume(coarse) + _correlations(coarse, 2, at_once(coarse))
    return max(hemisphere, rotations)


def _correlations(edge: int, exponents: int, poses: int) -> int:
    """What a `Correlator` takes [bytes]: volumes, spectra, correlations; sums, and maxima of rows."""
    cubes = exponents * poses
    large = (poses + cubes) * _volume(edge) + cubes * _half_spectrum(edge)
    return large + poses * 6 * _half_spectrum(edge) // edge + cubes * 4 * edge**2 + poses * edge**2 + cubes * 2**16


def _volume(edge: int) -> int:
    return 4 * edge**3


def _magnitude(edge: int) -> int:
    return 4 * edge**2 * (edge // 2 + 1)


def _half_spectrum(edge: int) -> int:
    return 8 * edge**2 * row_pitch(edge)


def _tilt_spectra(edge: int) -> int:
    images = image_edge(edge)
    return 8 * 2 * _layers(edge) * images * row_pitch(images)


def _layers(edge: int) -> int:
    return int(0.6 * edge / 2) + 1
