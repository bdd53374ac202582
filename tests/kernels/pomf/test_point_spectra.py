"""Whitened spectra and magnitudes of points equal NumPy's within a relative L2 error of 2e-6."""

import numpy as np
import pytest

from sonarmap.kernels.fft.edges import row_pitch
from sonarmap.kernels.pomf import point_spectra
from sonarmap.kernels.pomf.point_spectra import PointSpectra
from tests.samples.pomf_twin import occupied, relative_error

# multiples of 8, whose passes are fused on a processor, and others
EDGES = (16, *(pytest.param(edge, marks=pytest.mark.slow) for edge in (18, 40)))
TOLERANCE = 2e-6


def slab(edge, seed):
    """(400, 4): a tilted slab of unequal weights that leaves most planes and rows empty; a few points outside."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-0.3, 0.35, (2, 400)) * edge
    z = 0.2 * x - 0.1 * y + rng.normal(size=400)
    x[:3] = edge
    return np.column_stack([x, y, z, rng.uniform(0.2, 3, 400)]).astype(np.float32)


def centered(spectrum):
    return np.fft.fftshift(np.abs(spectrum), axes=(0, 1))


def empty_spectra(device, edge, count):
    return [device.empty((edge, edge, row_pitch(edge)), np.complex64) for _ in range(count)]


@pytest.mark.parametrize("edge", EDGES)
@pytest.mark.parametrize("exponents", [(1.0,), (1.0, 0.3, 0.0)])
def test_whitened_spectra(device, edge, exponents):
    """The second call shows that the first left the volume empty."""
    spectra = PointSpectra(device, edge, exponents)
    for seed in (1, 2):
        points, out = slab(edge, seed), empty_spectra(device, edge, len(exponents))
        spectra.transform(device.to_device(points), out)
        want = np.fft.rfftn(occupied(points[:, :3], edge, points[:, 3]))
        for exponent, got in zip(exponents, out, strict=True):
            # undo the whitening, or rounding would dominate where the spectrum is nearly 0
            assert relative_error(got.get()[..., : edge // 2 + 1] * np.abs(want) ** exponent, want) < TOLERANCE


@pytest.mark.parametrize("edge", EDGES)
@pytest.mark.parametrize("lanes", [8, 16])
def test_magnitudes(device, edge, lanes, monkeypatch):
    """With both vector lengths, whatever the device's own one is."""
    monkeypatch.setattr(point_spectra, "column_lanes", lambda _: lanes)
    points, (out,) = slab(edge, 3), empty_spectra(device, edge, 1)
    magnitudes = device.empty((edge, edge, edge // 2 + 1))
    PointSpectra(device, edge, magnitudes=True).transform(device.to_device(points), [out], magnitudes)
    want = np.fft.rfftn(occupied(points[:, :3], edge, points[:, 3]))
    assert relative_error(magnitudes.get(), centered(want)) < TOLERANCE
    assert relative_error(out.get()[..., : edge // 2 + 1] * np.abs(want), want) < TOLERANCE


def test_no_points_give_zeros(device):
    (out,) = empty_spectra(device, 16, 1)
    PointSpectra(device, 16).transform(device.empty((0, 4)), [out])
    assert not out.get()[..., :9].any()  # the padding may hold anything
