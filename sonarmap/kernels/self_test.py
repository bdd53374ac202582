"""Self-test of a device: its results are compared with NumPy, and those of small registrations with the true poses."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.arrays import Readback, upload_places
from sonarmap.kernels.device.device import Array, Device
from sonarmap.kernels.errors import DeviceError
from sonarmap.kernels.fft.edges import row_pitch
from sonarmap.kernels.fft.transform import RealFFT
from sonarmap.kernels.points.voxelize import voxelize
from sonarmap.kernels.pomf.correlator import Correlator, Pose
from sonarmap.kernels.pomf.peak import Peak, find_peaks
from sonarmap.kernels.pomf.point_spectra import PointSpectra
from sonarmap.kernels.so3.correlation import RotationCorrelation
from sonarmap.kernels.so3.harmonics import Harmonics, equalizers
from sonarmap.kernels.surface.cells import Elements, find_nearest, fit_planes, sort_into_cells
from sonarmap.kernels.surface.refinement import Noise, Refinement, Weighting

_FFT_TOLERANCE = 2e-6  # largest relative error of a transform, 5 times that of PoCL
# the last has odd radices, and a size that is no multiple of any device's alignment
_SHAPES = ((32, 64, 128), (256, 16, 16), (18, 30, 50))
_EDGE = 32  # voxels
_BANDWIDTH = 16
_TURN = Rotation.from_euler("ZYX", [24.0, -9.0, 6.0], degrees=True)
_SHIFT = np.array([2.0, -3.0, 1.0])  # voxels


@dataclass(frozen=True, slots=True)
class Measured:
    """The error of a device's result and its tolerance, in `unit`, as "voxels", or relative where that is ""."""

    what: str
    off: float
    tolerance: float
    unit: str = ""

    @property
    def passed(self) -> bool:
        """Whether the error is within its tolerance; NaN is not."""
        return bool(self.off <= self.tolerance)

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.what}: off by {self.off:.2g}{unit}, tolerance {self.tolerance:.2g}{unit}"


def measure(device: Device) -> Iterator[Measured]:
    """Run all checks, in a few seconds, most of it for compiling; errors of a device that cannot run one are raised."""
    return chain.from_iterable(check(device) for check in CHECKS)


def _transforms(device: Device) -> Iterator[Measured]:
    for shape in _SHAPES:
        rng = np.random.default_rng(shape[0])
        volume = rng.normal(size=shape).astype(np.float32)
        fft, valid = RealFFT(device, shape), shape[2] // 2 + 1
        spectrum = fft.forward(_behind_another(device, volume))
        want = np.fft.rfftn(volume.astype(np.float64))
        size = " x ".join(map(str, shape))
        yield Measured(f"the Fourier transform of {size}", _error(spectrum.get()[..., :valid], want), _FFT_TOLERANCE)
        yield Measured(f"the inverse transform of {size}", _error(fft.inverse(spectrum).get(), volume), _FFT_TOLERANCE)


def _voxels(device: Device) -> Iterator[Measured]:
    points, edge = _cloud(4000), 64
    place = points[:, :3].astype(np.float64) @ _TURN.as_matrix().T + _SHIFT + edge / 2 + 0.5
    clear = (np.abs(place - np.round(place)) > 1e-3).all(axis=1)  # others may fall into either of two voxels
    points, place = points[clear], place[clear]
    got = voxelize(device, device.to_device(points), edge, _TURN.as_matrix(), _SHIFT).get()
    want = np.zeros_like(got)
    np.maximum.at(want, tuple(np.floor(place).astype(int).T), points[:, 3])
    yield Measured("voxels of points", float(np.count_nonzero(got != want)), 0.0, "voxels")


def _registration(device: Device) -> Iterator[Measured]:
    """Register a cloud with its moved copy: the rotation from the magnitude spectra, then the shift."""
    target = _cloud(3000)
    source = target.copy()
    source[:, :3] = (target[:, :3] - _SHIFT) @ _TURN.as_matrix()  # _TURN of the source, then _SHIFT, is the target
    spectra = PointSpectra(device, _EDGE, magnitudes=True)
    harmonics = Harmonics(device, _BANDWIDTH, _EDGE, 2 * _EDGE)

    def prepared(points: np.ndarray) -> tuple[Array, Array]:
        magnitudes = device.empty((_EDGE, _EDGE, _EDGE // 2 + 1))
        whitened = device.empty((_EDGE, _EDGE, row_pitch(_EDGE)), np.complex64)
        spectra.transform(device.to_device(points), [whitened], magnitudes)
        layers = harmonics.analyze(magnitudes, np.linspace(3, 12, 10))
        products = Readback(device, harmonics.products(layers))
        return harmonics.mix(layers, equalizers(products.read(), 0.4)), whitened

    search = RotationCorrelation(device, _BANDWIDTH, np.deg2rad(60))
    (coefficients, whitened), (others, _) = prepared(target), prepared(source)
    correlation = search.correlate(coefficients, others)
    best, (peaks,) = _highest(device, correlation[0]), search.peaks(correlation)
    off = float(np.abs(peaks.index[0] - best.index).max()) if len(peaks.index) else np.inf
    yield Measured("the index of the best rotation", off, 0.0, "samples")
    R = search.rotations(best.shift)
    yield Measured("the rotation of a registration", float(np.rad2deg((R * _TURN.inv()).magnitude())), 5.0, "degrees")
    correlator, pose = Correlator(device, _EDGE, blur=1.0), Pose(_TURN.as_matrix())
    on_device = device.to_device(source)
    (peak,) = correlator.find(on_device, [pose], [whitened], 1, 3.0).peaks
    yield Measured("the shift of a registration", float(np.abs(peak.shift - _SHIFT).max()), 0.25, "voxels")
    (again,) = correlator.near(on_device, [pose], [whitened], np.array([peak.index])).read()
    yield Measured("the height of a peak near a known shift", float(abs(again.value / peak.value - 1)), 1e-3)


def _surfaces(device: Device) -> Iterator[Measured]:
    """Find the nearest points of a surface, and refine a pose that is slightly wrong."""
    target, source = _cloud(3000)[:, :3], _cloud(2500, seed=8)[:, :3]
    cells = sort_into_cells(device, target)
    turn, shift = Rotation.from_rotvec([0.02, -0.01, 0.015]), np.array([0.3, -0.2, 0.25])
    places = upload_places(device, source[:200])
    distances, _ = find_nearest(device, cells, places, turn.as_matrix()[None], shift[None], 1e3)
    moved = turn.apply(source[:200]) + shift
    want = np.linalg.norm(moved[:, None] - target, axis=2).min(axis=1)
    yield Measured("distances to a surface", _error(distances[0], want), 1e-5)
    surfaces = [
        Elements(fit_planes(device, each, np.eye(3), np.empty((0, 3)), farthest=2.0, aside=0.7), each)
        for each in (cells, sort_into_cells(device, source))
    ]
    weighting = Weighting(bell=1 / 6, wide_bell=0.8, bells=4.0, measured=3.0)
    steps = Refinement(device, surfaces[0], surfaces[1], 2000, weighting, Noise(1e-3, 2.0, 0.02, 1e-4, 0.1))
    steps.begin(turn.as_matrix()[None], shift[None], np.zeros(1))
    for reach in (4.0, 3.0, 2.0, 2.0, 1.5):
        steps.step(reach)
    steps.step(1.5, moves=False)
    poses, records = steps.end()
    record = records.read()
    angle = float(np.rad2deg(Rotation.from_matrix(record["turn"][0]).magnitude()))
    yield Measured("the rotation of a refinement", angle, 0.2, "degrees")
    yield Measured("the shift of a refinement", float(np.abs(record["shift"]).max()), 0.1, "voxels")
    apart = poses.get()[0, 3:12:4] - record["next_shift"][0]
    yield Measured("the shift of a refinement on the device", float(np.abs(apart).max()), 1e-4, "voxels")


# Every kernel that a registration needs has to be part of one of these checks.
CHECKS: tuple[Callable[[Device], Iterator[Measured]], ...] = (_transforms, _voxels, _registration, _surfaces)


def _cloud(count: int, seed: int = 7) -> np.ndarray:
    """(count, 4) float32: an asymmetric surface about the center of a grid of 32 voxels, with weights above 0."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-9, 9, (2, count))
    z = 2.5 * np.sin(0.35 * x + 0.4) + 0.012 * (y + 3) ** 2 * (x > -2) + 3.0 * ((x - 3) ** 2 + (y + 4) ** 2 < 9) - 2
    return np.column_stack([x, y, z, rng.uniform(0.5, 1.0, count)]).astype(np.float32)


def _behind_another(device: Device, volume: np.ndarray) -> Array:
    """The volume as the second slice of an array, with an offset that depends on its size."""
    return device.to_device(np.stack([np.zeros_like(volume), volume]))[1]


def _highest(device: Device, correlation: Array) -> Peak:
    peaks = find_peaks(device, correlation)
    if not peaks:
        raise DeviceError("it finds no peak in a correlation that has several")
    return peaks[0]


def _error(got: np.ndarray, want: np.ndarray) -> float:
    return float(np.linalg.norm(got - want) / np.linalg.norm(want))
