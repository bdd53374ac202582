"""Phase-only matched filtering in NumPy, float64: what kernels and translations are compared with."""

import numpy as np
from scipy.ndimage import maximum_filter


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
    n = len(correlation)
    tops = np.argwhere(correlation == maximum_filter(correlation, 3, mode="wrap"))
    if limits is not None:
        tops = tops[(np.minimum(tops, n - tops) <= limits).all(axis=1)]
    kept: list[np.ndarray] = []
    for place in tops[np.argsort(-correlation[tuple(tops.T)])]:
        if all(np.abs((place - other + n // 2) % n - n // 2).max() > separation for other in kept):
            kept.append(place)
        if len(kept) == count:
            break
    return [place.tolist() for place in kept]
