"""Operations on half spectra equal NumPy's within a relative L2 error of 1e-6; laws of the POMF."""

import numpy as np
import pytest

from sonarmap.kernels.pomf.spectrum import Pomf, cross_power, magnitude, sum_layers, whiten
from tests.samples.pomf_twin import padded, relative_error

SHAPES = [(16, 16, 16), (32, 16, 64), (5, 32, 16), (18, 54, 90)]


def random_spectrum(rng, shape, batched=False):
    axes = (1, 2) if batched else (0, 1, 2)
    return padded(np.fft.rfftn(rng.normal(size=shape), axes=axes), shape[2])


@pytest.mark.parametrize("edge", [16, 32])
def test_magnitude(device, edge):
    volume = np.random.default_rng(edge).normal(size=(edge, edge, edge))
    spectrum = padded(np.fft.rfftn(volume), edge)
    want = np.fft.fftshift(np.abs(np.fft.fftn(volume)), axes=(0, 1))[..., : edge // 2 + 1]
    got = magnitude(device, device.to_device(spectrum), edge).get()
    assert relative_error(got, want) < 1e-6
    assert got[edge // 2, edge // 2, 0] == pytest.approx(abs(volume.sum()), rel=1e-4)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("exponent", [1.0, 0.7, 0.0])
def test_whiten(device, shape, exponent):
    spectrum = random_spectrum(np.random.default_rng(1), shape)
    valid = shape[2] // 2 + 1
    spectrum[1, 2, 3], spectrum[2, 0, 1], spectrum[0, 0, 5] = 0, np.inf, complex(np.nan, 1)
    got = whiten(device, device.to_device(spectrum), exponent).get()
    assert (got[1, 2, 3], got[2, 0, 1], got[0, 0, 5]) == (0, 0, 0)
    assert np.isfinite(got).all()
    rest = np.isfinite(spectrum) & (spectrum != 0)
    rest[..., valid:] = False
    values = spectrum[rest].astype(np.complex128)
    assert relative_error(got[rest], values / np.abs(values) ** exponent) < 1e-6


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("blur", "batched"), [(0.0, False), (0.7, False), (1.3, True)])
def test_cross_power(device, shape, blur, batched):
    rng, along = np.random.default_rng(2), (0.0 if batched else blur, blur, blur)
    n0, n1, n2 = shape
    target, source = (whiten(device, device.to_device(random_spectrum(rng, shape, batched))) for _ in range(2))
    f0, f1, f2 = np.fft.fftfreq(n0) * (not batched), np.fft.fftfreq(n1), np.fft.rfftfreq(n2)
    squared = f0[:, None, None] ** 2 + f1[:, None] ** 2 + f2**2
    valid = n2 // 2 + 1
    want = (target.get() * np.conj(source.get()))[..., :valid] * np.exp(-2 * np.pi**2 * blur**2 * squared)
    got = cross_power(device, target, source, shape, along).get()
    assert relative_error(got[..., :valid], want) < 1e-6
    assert not got[..., valid:].any()
    if batched:
        summed = sum_layers(device, target, source, shape, blur).get()
        assert relative_error(summed[0, :, :valid], want.sum(axis=0)) < 1e-6
    assert cross_power(device, target, source, shape, along, out=target) is target
    np.testing.assert_array_equal(target.get(), got)


def test_pomf_of_batches_and_their_sum(device):
    shape = (5, 32, 64)
    rng = np.random.default_rng(8)
    source = rng.normal(size=shape).astype(np.float32)
    target = np.roll(source, (4, -9), axis=(1, 2)) + 0.3 * rng.normal(size=shape).astype(np.float32)
    pomf = Pomf(device, shape, blur=0.5, batched=True)
    prepared = [pomf.prepare(device.to_device(images)) for images in (target, source)]
    single = pomf.correlate(prepared[0], prepared[1]).get()
    for layer in single:
        assert np.unravel_index(layer.argmax(), layer.shape) == (4, 64 - 9)
    summed = pomf.correlate_layers(prepared[0], prepared[1]).get()
    assert relative_error(summed, single.sum(axis=0)) < 1e-5
