"""Phase-only matched filtering in NumPy, float64: what kernels and translations are compared with."""

import numpy as np
from scipy.ndimage import maximum_filter

from sonarmap.kernels.fft.edges import row_pitch


def relative_error(got: np.ndarray, want: np.ndarray) -> float:
    """The relative error in the 2-norm."""
    return float(np.linalg.norm(got - want) / np.linalg.norm(want))


def padded(spectrum: np.ndarray, length: int) -> np.ndarray:
    """A half spectrum of rows of this length in the kernels' layout; the padding is NaN, as it must not be read."""
    out = np.full((*spectrum.shape[:-1], row_pitch(length)), np.nan, np.complex64)
    out[..., : length // 2 + 1] = spectrum
    return out


def occupied(points: np.ndarray, edge: int, weights: np.ndarray | float = 1.0) -> np.ndarray:
    """(edge, edge, edge), the largest weight of the points (n, 3) in each voxel."""
    cells = np.floor(points + edge / 2 + 0.5).astype(int)
    inside = ((cells >= 0) & (cells < edge)).all(axis=1)
    volume = np.zeros((edge, edge, edge))
    np.maximum.at(volume, tuple(cells[inside].T), np.broadcast_to(weights, len(points))[inside])
    return volume


def correlation_of(target: np.ndarray, source: np.ndarray, exponent: float, blur: float) -> np.ndarray:
    """The correlation of two cubic volumes, whitened with the exponent and blurred [voxels]."""
    spectra = [np.fft.fftn(volume) for volume in (target, source)]
    first, second = (np.where(np.abs(f) > 1e-9, f / np.maximum(np.abs(f), 1e-9) ** exponent, 0) for f in spectra)
    gain = np.exp(-2 * (np.pi * blur * np.fft.fftfreq(len(target))) ** 2)
    return np.fft.ifftn(first * second.conj() * gain[:, None, None] * gain[:, None] * gain).real


def highest_maxima(
    correlation: np.ndarray, count: int, separation: float, limits: np.ndarray | None = None
) -> list[list[int]]:
    """Voxels of the highest local maxima within the limits, each farther than this from the others along an axis."""
    shape = np.array(correlation.shape)
    tops = np.argwhere(correlation == maximum_filter(correlation, 3, mode="wrap"))
    if limits is not None:
        tops = tops[(np.minimum(tops, shape - tops) <= limits).all(axis=1)]
    kept: list[np.ndarray] = []
    for place in tops[np.argsort(-correlation[tuple(tops.T)], kind="stable")]:
        if all(np.abs((place - other + shape // 2) % shape - shape // 2).max() > separation for other in kept):
            kept.append(place)
        if len(kept) == count:
            break
    return [place.tolist() for place in kept]
