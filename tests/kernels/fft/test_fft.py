"""Fourier transforms equal NumPy's within a relative L2 error of 3e-7, for all variants of kernels.

Kernels for a processor are written with 8 and with 16 lanes.
"""

from itertools import pairwise

import numpy as np
import pytest

from sonarmap.kernels.fft.edges import EDGES, neighbors, radices, row_pitch
from sonarmap.kernels.fft.transform import RealFFT
from tests.samples.pomf_twin import relative_error

TOLERANCE = 3e-7  # relative, in the 2-norm

# Rows that end within a tile of 4 and a block of 8, odd rows, axes that are no multiple of 8 or of 4.
FAST = [(16, 32, 64), (50, 18, 90)]
# Every edge on every axis, each beside others of very different size, along columns with vectors of either length.
SLOW = [(edge, EDGES[(n + 15) % len(EDGES)], EDGES[(n + 30) % len(EDGES)]) for n, edge in enumerate(EDGES)]
SLOW += [(96, 160, 20), (128, 128, 128), (160, 160, 160)]
CASES = [pytest.param(shape, lanes) for shape, lanes in zip(FAST, (8, 16), strict=True)]
CASES += [pytest.param(shape, 8 + 8 * (n % 2), marks=pytest.mark.slow) for n, shape in enumerate([*FAST[::-1], *SLOW])]


@pytest.fixture(autouse=True)
def lanes(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """Lengths of vectors, which only processors have."""
    count = getattr(request, "param", 8)
    monkeypatch.setattr("sonarmap.kernels.fft.transform.column_lanes", lambda _: count)
    return count


def real(shape: tuple[int, ...], seed: int = 7) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.3, 1.0, shape).astype(np.float32)


def complex_(shape: tuple[int, ...]) -> np.ndarray:
    return (real(shape, 8) + 1j * real(shape, 108)).astype(np.complex64)


def half(spectrum: np.ndarray, shape: tuple[int, int, int]) -> np.ndarray:
    return spectrum[..., : shape[2] // 2 + 1]


@pytest.mark.parametrize(("shape", "lanes"), CASES, indirect=["lanes"])
def test_real_is_rfftn_and_irfftn(device, shape):
    fft, volume = RealFFT(device, shape), real(shape)
    on_device = device.to_device(volume)
    spectrum = fft.forward(on_device)
    assert spectrum.shape == fft.half_shape == (shape[0], shape[1], row_pitch(shape[2]))
    assert relative_error(half(spectrum.get(), shape), np.fft.rfftn(volume.astype(float))) < TOLERANCE
    assert np.array_equal(on_device.get(), volume)
    # Any complex numbers, not only those of a real array; the padding must not matter.
    given = complex_(fft.half_shape)
    given[..., shape[2] // 2 + 1 :] = np.nan
    wanted = np.fft.irfftn(half(given, shape).astype(complex), shape, axes=(0, 1, 2))
    assert relative_error(fft.inverse(device.to_device(given)).get(), wanted) < TOLERANCE
    assert relative_error(fft.inverse(spectrum).get(), volume) < TOLERANCE


@pytest.mark.parametrize(("layers", "lanes"), [(77, 16), (1, 8)], indirect=["lanes"])
def test_batched_transforms_only_the_last_two_axes(device, layers):
    shape = (layers, 32, 64)
    fft, volume = RealFFT(device, shape, batched=True), real(shape)
    spectrum = fft.forward(device.to_device(volume))
    wanted = np.fft.rfft2(volume.astype(float))
    assert relative_error(half(spectrum.get(), shape), wanted) < TOLERANCE
    assert relative_error(fft.inverse(spectrum).get(), volume) < TOLERANCE


def test_repeated_transforms_are_equal(device):
    """Results do not depend on earlier contents of memory, and are written to `out`."""
    shape = (64, 16, 32)
    fft, volume = RealFFT(device, shape), device.to_device(real(shape))
    spectra = [device.to_device(np.full(fft.half_shape, fill, np.complex64)) for fill in (0, np.nan, 1e38)]
    first, *others = [half(fft.forward(volume, spectrum).get(), shape) for spectrum in spectra]
    assert all(np.array_equal(first, other) for other in others)
    out = device.empty(shape)
    assert fft.forward(volume, spectra[0]) is spectra[0]
    assert fft.inverse(spectra[0], out) is out


def test_edges_are_the_even_products_of_2_3_and_5():
    """The edges equal those of a search through the exponents, and each next one is at most 25 % larger."""
    products = {2**a * 3**b * 5**c for a in range(1, 10) for b in range(6) for c in range(4)}
    assert sorted(n for n in products if 16 <= n <= 512) == list(EDGES)
    assert {16, 96, 160, 192, 320, 384, 512} < set(EDGES)
    assert max(b / a for a, b in pairwise(EDGES)) <= 1.25
    near = {98: (96, 100), 97: (96, 100), 17: (16, 18), 130: (128, 144), 8: (16, 18), 1000: (500, 512)}
    assert {edge: neighbors(edge) for edge in near} == near
    for edge in EDGES:  # rows of spectra are whole blocks
        assert row_pitch(edge) % 8 == 0
        assert edge // 2 + 1 <= row_pitch(edge) <= edge // 2 + 8


def test_product_of_radices_is_the_edge():
    for points in (*range(8, 17), 25, 27, 45, 81, 125, 243, *EDGES):
        if all(points % prime for prime in (7, 11, 13)):
            chosen = radices(points)
            assert np.prod(chosen) == points
            assert list(chosen) == sorted(chosen)
            assert 1 + (points >= 16) <= len(chosen) <= 4
