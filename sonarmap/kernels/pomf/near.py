# pyright: strict, reportUnknownMemberType=false
"""Correlations near known shifts, from sums over their spectra: no transform back, no other voxel."""

import numpy as np
from numpy.typing import NDArray

from sonarmap.kernels.errors import InputError
from sonarmap.kernels.fft.edges import row_pitch
from sonarmap.kernels.pomf.peak import NOT_FINITE
from sonarmap.kernels.pomf.peak_fit import Peak, fit_peaks
from sonarmap.kernels.pomf.spectrum import half_weights

# Rows of sums for each shift, as in near.cl: 5 x 5 shifts along the first axes, then five of which two are the power's.
SUMS = 30


def highest_near(edge: int, places: NDArray[np.int64], sums: NDArray[np.complex64]) -> list[Peak]:
    """For each voxel (m, 3) the highest of the 27 around it, whether it is a peak or lies on a slope.

    The mean is the term of frequency 0, the deviation that of the spectrum, by Parseval's theorem.

    Args:
        sums: of near.cl, (m, `SUMS`, `row_pitch(edge)`) complex64.

    Raises:
        InputError: a correlation is not finite.
    """
    n, exact = edge, sums.astype(np.complex128)
    if not np.isfinite(exact.view(np.float64)).all():
        raise InputError(NOT_FINITE)
    weights = half_weights(n)
    mean = exact[:, 25, 0].imag / n**3
    variance = exact[:, 25].real @ weights / n**6 - mean**2
    around = _values(edge, places, exact[:, :25] * weights)
    inner = around[:, 1:-1, 1:-1, 1:-1].reshape(len(around), 27)
    highest = inner.argmax(axis=1)
    tops = np.column_stack([highest // 9, highest // 3 % 3, highest % 3])
    cubes = np.stack(
        [cube[i : i + 3, j : j + 3, k : k + 3] for cube, (i, j, k) in zip(around, tops.tolist(), strict=True)]
    )
    return fit_peaks((places + tops - 1) % n, cubes, (n, n, n), mean, np.sqrt(np.maximum(variance, 0)))


def _values(n: int, places: NDArray[np.int64], sums: np.ndarray) -> np.ndarray:
    """(m, 5, 5, 5) float32: the last axis of the sums (m, 25, pitch), by frequency, at 5 voxels."""
    columns = places[:, 2, None] + np.arange(-2, 3)
    turns: NDArray[np.int64] = np.arange(row_pitch(n))[:, None] * columns[:, None, :] % n
    values = np.real(np.matmul(sums, np.exp(2j * np.pi / n * turns))) / n**3
    return values.reshape(-1, 5, 5, 5).astype(np.float32)
