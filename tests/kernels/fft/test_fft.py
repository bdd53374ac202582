"""Fourier transforms against NumPy's in double precision, in both ways of writing the kernels.

The flavor for graphics processors runs on every device, the one for processors on those only.
"""

import numpy as np
import pytest

from kernels.device.device import Device
from kernels.errors import DeviceError, InputError
from kernels.fft.transform import Flavor, RealFFT

TOLERANCE = 3e-7  # relative, in the 2-norm

# Together they have every edge from 16 to 512 on every axis.
SHAPES = [
    (16, 32, 64),
    (512, 16, 128),
    (32, 512, 16),
    (64, 128, 32),
    (128, 64, 256),
    (256, 16, 512),
    (16, 256, 16),
]
FAST = [(16, 32, 64), (512, 16, 32)]
cases = pytest.mark.parametrize(
    "shape",
    [pytest.param(shape, marks=() if shape in FAST else pytest.mark.slow) for shape in [*SHAPES, (512, 16, 32)]],
)


@pytest.fixture(params=["cpu", "gpu"])
def flavor(request: pytest.FixtureRequest, device: Device) -> Flavor:
    if request.param == "cpu" and not device.is_cpu:
        pytest.skip("this device is no processor")
    return request.param


def real(shape: tuple[int, ...], seed: int = 7) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.3, 1.0, shape).astype(np.float32)


def complex_(shape: tuple[int, ...], seed: int = 8) -> np.ndarray:
    return (real(shape, seed) + 1j * real(shape, seed + 100)).astype(np.complex64)


def difference(found: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.linalg.norm((found - wanted).ravel()) / np.linalg.norm(wanted.ravel()))


def half(spectrum: np.ndarray, shape: tuple[int, int, int]) -> np.ndarray:
    return spectrum[..., : shape[2] // 2 + 1]


@cases
def test_real_is_rfftn_and_irfftn(device, flavor, shape):
    fft, volume = RealFFT(device, shape, flavor=flavor), real(shape)
    on_device = device.to_device(volume)
    spectrum = fft.forward(on_device)
    assert spectrum.shape == fft.half_shape == (shape[0], shape[1], shape[2] // 2 + 8)
    assert difference(half(spectrum.get(), shape), np.fft.rfftn(volume.astype(float))) < TOLERANCE
    assert np.array_equal(on_device.get(), volume)
    # Any complex numbers, not only those of a real array; the padding must not matter.
    given = complex_(fft.half_shape)
    given[..., shape[2] // 2 + 1 :] = np.nan
    wanted = np.fft.irfftn(half(given, shape).astype(complex), shape, axes=(0, 1, 2))
    assert difference(fft.inverse(device.to_device(given)).get(), wanted) < TOLERANCE
    assert difference(fft.inverse(spectrum).get(), volume) < TOLERANCE


@pytest.mark.parametrize("layers", [1, 77])
def test_batched_leaves_the_first_axis(device, flavor, layers):
    shape = (layers, 32, 64)
    fft, volume = RealFFT(device, shape, batched=True, flavor=flavor), real(shape)
    spectrum = fft.forward(device.to_device(volume))
    wanted = np.fft.rfft2(volume.astype(float))
    assert difference(half(spectrum.get(), shape), wanted) < TOLERANCE
    assert difference(fft.inverse(spectrum).get(), volume) < TOLERANCE


def test_writes_to_out(device):
    shape = (16, 32, 64)
    fft, volume = RealFFT(device, shape), real(shape)
    out, back = device.empty(fft.half_shape, np.complex64), device.empty(shape)
    assert fft.forward(device.to_device(volume), out) is out
    assert fft.inverse(out, back) is back
    assert difference(back.get(), volume) < TOLERANCE


def test_laws(device):
    """Linearity, Parseval's theorem and the shift law."""
    shape = (16, 32, 64)
    fft, a, b = RealFFT(device, shape), real(shape, 1), real(shape, 2)

    def forward(volume: np.ndarray) -> np.ndarray:
        return half(fft.forward(device.to_device(volume)).get(), shape)

    A, B = forward(a), forward(b)
    assert difference(forward(2.5 * a - 0.75 * b), 2.5 * A - 0.75 * B) < TOLERANCE
    weight = np.full(33, 2.0)
    weight[[0, 32]] = 1.0
    energy = np.sum(weight * np.abs(A.astype(complex)) ** 2) / a.size
    assert energy == pytest.approx(np.sum(a.astype(float) ** 2), rel=1e-6)
    kx, ky, kz = np.ogrid[:16, :32, :33]
    turn = np.exp(-2j * np.pi * (3 * kx / 16 + 5 * ky / 32 + 11 * kz / 64))
    assert difference(forward(np.roll(a, (3, 5, 11), (0, 1, 2))), A * turn) < 2 * TOLERANCE


def test_one_transform_is_the_same_every_time(device):
    """Nothing depends on what memory held before."""
    shape = (64, 16, 32)
    fft, volume = RealFFT(device, shape), device.to_device(real(shape))
    spectra = [device.to_device(np.full(fft.half_shape, fill, np.complex64)) for fill in (0, np.nan, 1e38)]
    first, *others = [half(fft.forward(volume, spectrum).get(), shape) for spectrum in spectra]
    assert all(np.array_equal(first, other) for other in others)


@pytest.mark.parametrize("shape", [(24, 32, 64), (16, 8, 64), (16, 32, 1024), (0, 32, 32), (16, 16)])
def test_refuses_other_edges(device, shape):
    with pytest.raises(InputError, match="16, 32, 64, 128, 256, 512"):
        RealFFT(device, shape)


def test_refuses_batches_without_layers(device):
    with pytest.raises(InputError, match="last two edges"):
        RealFFT(device, (0, 32, 32), batched=True)


def test_refuses_other_arrays(device):
    fft = RealFFT(device, (16, 32, 64))
    with pytest.raises(InputError, match="`volume` is float64"):
        fft.forward(device.to_device(np.zeros((16, 32, 64))))
    with pytest.raises(InputError, match=r"wanted complex64 of shape \(16, 32, 40\)"):
        fft.inverse(device.to_device(np.zeros((16, 32, 33), np.complex64)))
    wider = device.to_device(np.zeros((16, 32, 65), np.float32))
    with pytest.raises(InputError, match="in C order"):
        fft.forward(wider[:, :, 1:])


def test_refuses_what_the_device_cannot_hold(device, monkeypatch):
    fft, volume = RealFFT(device, (16, 32, 64)), device.to_device(real((16, 32, 64)))

    def refuse(*_: object) -> None:
        raise DeviceError("too large")

    monkeypatch.setattr(device, "require", refuse)
    with pytest.raises(DeviceError, match="too large"):
        fft.forward(volume)


@pytest.mark.parametrize("edge", [128, pytest.param(256, marks=pytest.mark.slow)])
def test_real_cubes_of_the_grids_in_use(device, flavor, edge):
    shape = (edge, edge, edge)
    fft, volume = RealFFT(device, shape, flavor=flavor), real(shape)
    spectrum = fft.forward(device.to_device(volume))
    assert difference(half(spectrum.get(), shape), np.fft.rfftn(volume.astype(float))) < TOLERANCE
    assert difference(fft.inverse(spectrum).get(), volume) < TOLERANCE
