"""A benchmark case per kernel: the bytes that it moves, and a call that queues its work.

The bytes are those that the algorithm must move: the valid elements of each input and output array, once. A transform
in three dimensions passes over its array twice, along rows and columns and along the first axis, as no cache holds it.
Transforms are also compared with other libraries that are installed. A new case is a function of a `Workload`
and a line in CASES.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

import numpy as np
import scipy.fft

from sonarmap.kernels.device.arrays import upload_places, upload_poses
from sonarmap.kernels.fft.transform import RealFFT
from sonarmap.kernels.points.visibility import Viewing, agreement, upload_points, upload_viewpoints
from sonarmap.kernels.points.voxelize import voxelize
from sonarmap.kernels.pomf.correlator import Correlator, Pose
from sonarmap.kernels.pomf.spectrum import Pomf, cross_power, magnitude, whiten
from sonarmap.kernels.resample import layers
from sonarmap.kernels.so3.correlation import RotationCorrelation
from sonarmap.kernels.surface.cells import find_nearest, fit_planes, sort_into_cells
from sonarmap.tools.lab.bench.timing import copier
from sonarmap.tools.lab.bench.workload import BANDWIDTH, SMALL_SHIFT, SMALL_TURN, R, Workload

BLUR = 0.7  # standard deviation of the blur in the correlation over translations [voxels]


@dataclass(frozen=True, slots=True)
class Peer:
    """Another library that does the same work."""

    name: str  # of the library
    run: Callable[[], object]  # do the work and wait for its end
    restore: Callable[[], object] = lambda: None  # restore input that `run` overwrites


@dataclass(frozen=True, slots=True)
class KernelCase:
    """A kernel on one input."""

    name: str  # of the kernel in its module
    moved: int  # bytes that the algorithm must move
    run: Callable[[], object]  # queue the kernel's work without waiting for it
    restore: Callable[[], object] = lambda: None  # restore input that `run` overwrites
    peers: Callable[[], list[Peer]] = list  # create the peers


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
    moved = w.half_bytes + w.half_bytes // 2
    return KernelCase("magnitude", moved, run=lambda: magnitude(w.device, spectrum, w.edge, out=out))


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
    moved = w.volume_bytes + 3 * w.half_bytes  # whitening can be fused into the last pass
    return KernelCase("Pomf.prepare", moved, run=lambda: pomf.prepare(volume, out=out))


def correlate_case(w: Workload) -> KernelCase:
    pomf = Pomf(w.device, w.volume.shape, BLUR)
    target, source = _whitened(w)
    out = w.device.empty(w.volume.shape)
    moved = 4 * w.half_bytes + w.volume_bytes  # the product can be fused into the first pass
    return KernelCase("Pomf.correlate", moved, run=lambda: pomf.correlate(target, source, out=out))


def _whitened(w: Workload) -> tuple[Any, Any]:
    """Whitened half spectra on the device: of a target, the shifted source plus noise, and of the source."""
    pomf = Pomf(w.device, w.volume.shape)
    return pomf.prepare(w.upload(w.shifted)), pomf.prepare(w.upload(w.volume))


def fft_peers(w: Workload, inverse: bool) -> list[Peer]:
    """The installed ones of FFTW and VkFFT."""
    return [make(w, inverse) for name, make in _FFT_PEERS.items() if find_spec(name)]


def peer_versions() -> dict[str, str]:
    """Versions of the installed peers."""
    return {name: version(name) for name in _FFT_PEERS if find_spec(name)}


def _pyfftw(w: Workload, inverse: bool) -> Peer:
    """FFTW, planned by measuring, with a thread per core."""
    import pyfftw

    volume = pyfftw.empty_aligned(w.volume.shape, np.float32)
    spectrum = pyfftw.empty_aligned(w.spectrum.shape, np.complex64)
    arrays, source = ((spectrum, volume), w.spectrum) if inverse else ((volume, spectrum), w.volume)
    direction = "FFTW_BACKWARD" if inverse else "FFTW_FORWARD"
    plan = pyfftw.FFTW(*arrays, axes=(0, 1, 2), direction=direction, flags=("FFTW_MEASURE",), threads=w.cores)

    def restore() -> None:
        arrays[0][:] = source  # planning overwrites it, and so does every inverse

    restore()
    return Peer("pyfftw", plan, restore) if inverse else Peer("pyfftw", plan.execute)


def _pyvkfft(w: Workload, inverse: bool) -> Peer:
    """VkFFT on the same device."""
    # not a dependency of sonarmap, as pip has to compile it
    app_class = import_module("pyvkfft.opencl").VkFFTApp
    app = app_class(w.volume.shape, np.float32, w.device.queue, r2c=True, inplace=False)
    volume, spectrum = w.upload(w.volume), w.upload(w.spectrum)
    work, arrays = (app.ifft, (spectrum, volume)) if inverse else (app.fft, (volume, spectrum))

    def run() -> None:
        work(*arrays)
        w.device.queue.finish()

    return Peer("pyvkfft", run, (lambda: spectrum.set(w.spectrum)) if inverse else (lambda: None))


_FFT_PEERS = {"pyfftw": _pyfftw, "pyvkfft": _pyvkfft}


def voxelize_case(w: Workload) -> KernelCase:
    points, out = w.upload(w.points), w.device.empty((w.edge,) * 3)
    moved = w.points.nbytes + w.volume_bytes + 8 * len(w.points)
    return KernelCase("voxelize", moved, run=lambda: voxelize(w.device, points, w.edge, R, out=out))


def sample_case(w: Workload) -> KernelCase:
    directions = layers.rectangular_unwrap(w.edge, "y")
    volume = magnitude(w.device, w.upload_half(w.spectrum), w.edge)
    table = layers.upload_directions(w.device, directions)
    out = w.device.empty((len(w.radii), w.edge, w.edge))
    first, last = float(w.radii[0]), float(w.radii[-1])
    shell = 4 * round(2 / 3 * np.pi * (last**3 - first**3))
    moved = shell + directions.nbytes + out.nbytes
    return KernelCase("sample", moved, run=lambda: layers.sample(w.device, volume, table, w.radii, R, out=out))


def normalize_layers_case(w: Workload) -> KernelCase:
    mask = layers.valid_pixels(layers.rotational_unwrap(w.edge))
    window = np.outer(np.hanning(w.edge), np.hanning(w.edge)).astype(np.float32)
    stack, device_window, device_mask = w.upload(w.layers), w.upload(window), w.upload(mask)
    out = w.device.empty(w.layers.shape)
    return KernelCase(
        "normalize_layers",
        3 * w.layers.nbytes,
        run=lambda: layers.normalize_layers(w.device, stack, device_window, device_mask, out=out),
    )


def polar_magnitude_case(w: Workload) -> KernelCase:
    host = np.asarray(scipy.fft.rfft2(w.layers, workers=w.cores))
    spectrum = w.upload_half(host)
    radii = np.linspace(0.11, 0.45, w.edge // 2) * (w.edge / 2)
    angles = np.arange(min(2 * w.edge, 512)) * (np.pi / min(2 * w.edge, 512))
    out = w.device.empty((len(host), len(radii), len(angles)))
    ring = 8 * round(np.pi / 2 * (radii[-1] ** 2 - radii[0] ** 2))
    return KernelCase(
        "polar_magnitude",
        ring * len(host) + out.nbytes,
        run=lambda: layers.polar_magnitude(w.device, spectrum, (w.edge, w.edge), radii, angles, out=out),
    )


_FARTHEST = 2.0  # largest distance of a point from its plane [voxels]
_POINT_BYTES = 16  # of a point among its cells
_ELEMENT_BYTES = 48  # of a surface element


def nearest_case(w: Workload) -> KernelCase:
    cells, places = sort_into_cells(w.device, w.surface), upload_places(w.device, w.surface)
    return KernelCase(
        "find_nearest",
        2 * _POINT_BYTES * len(w.surface) + 8 * len(w.surface),
        run=lambda: find_nearest(w.device, cells, places, SMALL_TURN[None], SMALL_SHIFT[None], w.edge),
    )


def planes_case(w: Workload) -> KernelCase:
    cells = sort_into_cells(w.device, w.surface)
    return KernelCase(
        "fit_planes",
        (_POINT_BYTES + _ELEMENT_BYTES) * len(w.surface),
        run=lambda: fit_planes(w.device, cells, np.eye(3), np.empty((0, 3)), farthest=_FARTHEST, aside=1.0),
    )


# Rotation angle of the z axis by roll and pitch of 35 degrees [rad]
_LARGEST = float(np.arccos(np.cos(np.deg2rad(35)) ** 2))
_REACH = 1.5  # tolerance of ranges at the sensor [voxels]
_SLOPE = 0.03  # its growth per voxel of range


def correlate_rotations_case(w: Workload) -> KernelCase:
    correlation = RotationCorrelation(w.device, BANDWIDTH, _LARGEST)
    edge = correlation.edge
    target, source = (w.upload(coefficients) for coefficients in w.coefficients)
    images, degrees = len(correlation.betas) + 1, np.arange(0, BANDWIDTH, 2)
    table = 4 * len(correlation.betas) * int(((2 * degrees + 1) * (degrees + 1)).sum())
    half, volume = 8 * images * edge * (edge // 2 + 1), 4 * images * edge**2
    moved = 2 * target.nbytes + table + 4 * half + volume
    return KernelCase("RotationCorrelation", moved, run=lambda: correlation.correlate(target, source))


def rotation_peaks_case(w: Workload) -> KernelCase:
    correlation = RotationCorrelation(w.device, BANDWIDTH, _LARGEST)
    target, source = (w.upload(coefficients) for coefficients in w.coefficients)
    values = correlation.correlate(target, source)
    return KernelCase("RotationCorrelation.peaks", values.nbytes, run=lambda: correlation.peaks(values))


def agreement_case(w: Workload) -> KernelCase:
    R, t = w.poses
    poses, center = upload_poses(w.device, R, t), upload_viewpoints(w.device, np.zeros((1, 3)))
    viewing = Viewing(w.upload(w.view[None]), center, upload_points(w.device, w.seen))
    moved = w.view.nbytes + w.seen.nbytes + len(w.poses[0]) * 19 * 4
    return KernelCase("agreement", moved, run=lambda: agreement(w.device, [viewing], poses, [(_REACH, _SLOPE)]).read())


def find_case(w: Workload) -> KernelCase:
    correlator, points, target = _given(w)
    moved = w.points.nbytes + 5 * w.half_bytes + w.volume_bytes
    return KernelCase("Correlator.find", moved, run=lambda: correlator.find(points, [Pose(R)], [target], 1, 3.0))


def near_case(w: Workload) -> KernelCase:
    correlator, points, target = _given(w)
    shift = np.zeros((1, 3), np.int64)
    moved = w.points.nbytes + 3 * w.half_bytes
    return KernelCase("Correlator.near", moved, run=lambda: correlator.near(points, [Pose(R)], [target], shift).read())


def _given(w: Workload) -> tuple[Correlator, Any, Any]:
    """A correlator, and the points and their whitened spectrum under `R` on the device."""
    points = w.upload(w.points)
    target = Pomf(w.device, (w.edge,) * 3).prepare(voxelize(w.device, points, w.edge, R))
    return Correlator(w.device, w.edge, BLUR), points, target


CASES: tuple[Callable[[Workload], KernelCase], ...] = (
    copy_case,
    real_forward_case,
    real_inverse_case,
    voxelize_case,
    magnitude_case,
    whiten_case,
    cross_power_case,
    prepare_case,
    correlate_case,
    sample_case,
    normalize_layers_case,
    polar_magnitude_case,
    correlate_rotations_case,
    rotation_peaks_case,
    agreement_case,
    find_case,
    near_case,
    nearest_case,
    planes_case,
)
