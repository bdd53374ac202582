"""Operations on half spectra against NumPy: relative L2 error within 1e-6, and the POMF's laws."""

import numpy as np
import pytest

from sonarmap.kernels.pomf.spectrum import Pomf, cross_power, magnitude, sum_layers, whiten
from tests.samples.pomf_twin import padded, relative_error
from tests.samples.refusals import refuses

SHAPES = [(16, 16, 16), (32, 16, 64), (5, 32, 16), (18, 54, 90)]


def random_spectrum(rng, shape, batched=False):
    axes = (1, 2) if batched else (0, 1, 2)
    return padded(np.fft.rfftn(rng.normal(size=shape), axes=axes), shape[2])


@pytest.mark.parametrize("edge", [16, 32, 64])
def test_magnitude(device, edge):
    volume = np.random.default_rng(edge).normal(size=(edge, edge, edge))
    spectrum = padded(np.fft.rfftn(volume), edge)
    want = np.fft.fftshift(np.abs(np.fft.fftn(volume)), axes=(0, 1))[..., : edge // 2 + 1]
    got = magnitude(device, device.to_device(spectrum), edge).get()
    assert relative_error(got, want) < 1e-6
    assert got[edge // 2, edge // 2, 0] == pytest.approx(abs(volume.sum()), rel=1e-4)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("exponent", [1.0, 0.5, 0.7, 0.25, 0.0])
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


def test_half_whitened_spectra_correlate_as_their_amplitudes_say(device):
    """Half of the exponent on both sides: the correlation's spectrum has the magnitude of one of them."""
    shape = (16, 32, 16)
    volume = device.to_device(np.random.default_rng(9).normal(size=shape).astype(np.float32))
    pomf = Pomf(device, shape)
    half = whiten(device, pomf.transform(volume), 0.5)
    correlation = pomf.correlate(half, half).get()
    want = np.fft.irfftn(np.abs(np.fft.rfftn(volume.get())), shape, axes=(0, 1, 2))
    assert relative_error(correlation, want) < 1e-5


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


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("shape", [(16, 32, 64), (32, 32, 32)])
def test_pomf_finds_a_cyclic_shift(device, shape):
    source = np.random.default_rng(6).normal(size=shape).astype(np.float32)
    shift = (3, -7, 11)
    target = np.roll(source, shift, axis=(0, 1, 2))  # target(x) = source(x - shift)
    pomf = Pomf(device, shape)
    prepared = [pomf.prepare(device.to_device(volume)) for volume in (target, source)]
    for _ in range(2):  # the prepared spectra survive their use
        correlation = pomf.correlate(prepared[0], prepared[1]).get()
        want = np.zeros(shape)
        want[tuple(s % n for s, n in zip(shift, shape, strict=True))] = 1
        assert np.abs(correlation - want).max() < 1e-4


def test_pomf_blur_is_a_gaussian_of_that_deviation(device):
    shape, blur = (32, 32, 32), 1.5
    volume = device.to_device(np.random.default_rng(7).normal(size=shape).astype(np.float32))
    pomf = Pomf(device, shape, blur=blur)
    spectrum = pomf.prepare(volume)
    correlation = pomf.correlate(spectrum, spectrum).get()
    x = np.arange(-4, 5)
    want = np.exp(-(x**2) / (2 * blur**2)) / (np.sqrt(2 * np.pi) * blur) ** 3
    np.testing.assert_allclose(correlation[x, 0, 0], want, atol=2e-5)
    np.testing.assert_allclose(correlation[0, 0, x], want, atol=2e-5)


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


def test_refuses_what_it_cannot_use(device):
    spectrum = device.empty((16, 16, 16), np.complex64)
    refuses("`spectrum` is complex64", magnitude, device, spectrum, 32)
    refuses("wanted complex64", whiten, device, device.empty((16, 16, 16)))
    refuses("multiple of 8", whiten, device, device.empty((16, 9), np.complex64))
    for exponent in (-0.1, 1.5, float("nan")):
        refuses(r"`exponent=.*give 0, plain correlation, to 1, phase only", whiten, device, spectrum, exponent)
    refuses("`source` is", cross_power, device, spectrum, device.empty((8, 16, 16), np.complex64), (16, 16, 16))
    refuses("blur", cross_power, device, spectrum, spectrum, (16, 16, 16), blur=(0, -1, 0))
    refuses("batched=True", Pomf(device, (16, 16, 16)).correlate_layers, spectrum, spectrum)
