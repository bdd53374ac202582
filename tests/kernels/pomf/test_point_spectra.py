"""Spectra of points, whitened and in magnitude, against NumPy: relative L2 error within 2e-6."""

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.kernels.fft.edges import row_pitch
from sonarmap.kernels.pomf import point_spectra
from sonarmap.kernels.pomf.point_spectra import PointSpectra
from tests.samples.refusals import refuses

# multiples of 8, whose passes are fused on a processor, and others
EDGES = (16, 24, 40, 50, 72)
TOLERANCE = 2e-6


def slab(edge, seed, count=400):
    """(count, 4): a tilted slab that leaves most planes and rows empty, of unequal weights; a few points beyond."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-0.3, 0.35, (2, count)) * edge
    z = 0.2 * x - 0.1 * y + rng.normal(size=count)
    x[:3] = edge
    return np.column_stack([x, y, z, rng.uniform(0.2, 3, count)]).astype(np.float32)


def transform_of(points, edge):
    """The whole half spectrum of the volume, complex128."""
    volume = np.zeros((edge, edge, edge))
    cells = np.floor(points[:, :3] + np.float32(edge / 2 + 0.5)).astype(int)
    inside = ((cells >= 0) & (cells < edge)).all(axis=1)
    np.maximum.at(volume, tuple(cells[inside].T), points[inside, 3])
    return np.fft.rfftn(volume)


def centered(spectrum):
    return np.fft.fftshift(np.abs(spectrum), axes=(0, 1))


def empty_spectra(device, edge, count):
    return [device.empty((edge, edge, row_pitch(edge)), np.complex64) for _ in range(count)]


def error(got, want):
    return np.linalg.norm(got - want) / np.linalg.norm(want)


@pytest.mark.parametrize("edge", EDGES)
@pytest.mark.parametrize("exponents", [(1.0,), (0.5, 1.0), (1.0, 0.3, 0.0)])
def test_whitened(device, edge, exponents):
    """Twice, as the first call has to leave the volume empty."""
    spectra = PointSpectra(device, edge, exponents)
    for seed in (1, 2):
        points, out = slab(edge, seed), empty_spectra(device, edge, len(exponents))
        spectra.transform(device.to_device(points), out)
        want = transform_of(points, edge)
        for exponent, got in zip(exponents, out, strict=True):
            # times what whitening divides by, or rounding would count most where there is next to nothing
            assert error(got.get()[..., : edge // 2 + 1] * np.abs(want) ** exponent, want) < TOLERANCE


@pytest.mark.parametrize("edge", EDGES)
@pytest.mark.parametrize("lanes", [8, 16])
def test_magnitudes(device, edge, lanes, monkeypatch):
    """With vectors of either length, whichever the device has by itself."""
    monkeypatch.setattr(point_spectra, "column_lanes", lambda _: lanes)
    points, (out,) = slab(edge, 3), empty_spectra(device, edge, 1)
    magnitudes = device.empty((edge, edge, edge // 2 + 1))
    PointSpectra(device, edge, magnitudes=True).transform(device.to_device(points), [out], magnitudes)
    want = transform_of(points, edge)
    assert error(magnitudes.get(), centered(want)) < TOLERANCE
    assert error(out.get()[..., : edge // 2 + 1] * np.abs(want), want) < TOLERANCE


@pytest.mark.parametrize("farthest", [0.0, 5.5, 12.0])
def test_magnitudes_that_are_needed(device, farthest):
    """Up to the farthest they are there; the others may be."""
    edge = 40
    points, (out,) = slab(edge, 4), empty_spectra(device, edge, 1)
    magnitudes = device.to_device(np.full((edge, edge, edge // 2 + 1), np.nan, np.float32))
    PointSpectra(device, edge, magnitudes=True).transform(device.to_device(points), [out], magnitudes, farthest)
    along = np.arange(edge) - edge // 2
    x, y, z = np.meshgrid(along, along, np.arange(edge // 2 + 1), indexing="ij")
    needed = x**2 + y**2 + z**2 <= farthest**2
    got, want = magnitudes.get(), centered(transform_of(points, edge))
    assert error(got[needed], want[needed]) < TOLERANCE
    written = ~np.isnan(got)
    assert error(got[written], want[written]) < TOLERANCE


def test_no_points_leave_zeros(device):
    out = empty_spectra(device, 16, 1)
    PointSpectra(device, 16).transform(device.empty((0, 4)), out)
    assert not out[0].get()[..., :9].any()  # the padding may hold anything


def test_refuses_what_was_not_planned(device):
    points, out = device.to_device(slab(16, 1)), empty_spectra(device, 16, 2)
    refuses("2 spectra for 1 exponents", PointSpectra(device, 16).transform, points, out)
    with pytest.raises(InputError, match="magnitudes True; wanted one for each, and magnitudes False"):
        PointSpectra(device, 16).transform(points, out[:1], device.empty((16, 16, 9)))
    refuses("`out` is", PointSpectra(device, 24).transform, points, out[:1])
    with pytest.raises(InputError, match="`magnitudes` is"):
        PointSpectra(device, 16, magnitudes=True).transform(points, out[:1], device.empty((16, 16, 8)))
